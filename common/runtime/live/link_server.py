"""Query endpoint of a live service for its injected links: read them, set them, share them."""

import logging
import time
from collections import deque
from typing import Any

import zenoh

from common.links.config import Links
from common.links.control import (
    LinkControlError,
    LinkReply,
    LiveLinks,
    from_wire,
    to_wire,
)
from common.queries import LINKS
from common.runtime.inbox_links import InboxLinks
from common.runtime.live.components import NEVER, Component, RunnerContext
from common.schemas import LinkChange
from common.topics import LINK_CHANGE

_log = logging.getLogger(__name__)

ASK_AT_S = (0.0, 0.5, 1.0, 2.0, 3.5, 5.0, 8.0)
"""When a new service asks its peers, after its start. One answer is not enough: it may come from a
peer that is as new and knows nothing yet."""
_REPEAT_S = (0.0, 3.0, 10.0)
"""When the links of the start are published, after the first subscriber appeared: a recorder may
come a little later."""
_RETRY_NS = 250_000_000
_MAX_WAITING = 32
_QUERY_TIMEOUT_S = 2.0


class LinkServer(Component):
    """Answers queries on ``<robot>/links/<service>``; see :mod:`common.links.control`.

    The transport's threads only queue what comes. Between two steps one query is answered and one
    peer's answer is taken over.
    """

    writes = (LINK_CHANGE,)

    def __init__(self, service: str, configured: Links) -> None:
        """Serve the inputs of ``service``, which starts with the links ``configured`` for it."""
        self._service, self._configured = service, configured
        self._queries: deque[Any] = deque()
        self._answers: deque[bytes] = deque(maxlen=_MAX_WAITING)
        self._initial: dict[str, LinkChange] = {}
        """Links of the start that are to be published, by topic."""
        self._repeat_at: list[int] = []
        self._changes: deque[LinkChange] = deque(maxlen=256)
        """Changes that are to be published."""
        self._publish_at = 0
        self._queryable: Any = None

    def open(self, context: RunnerContext) -> None:
        """Answer queries from now on, and ask the peers what was set before."""
        self._context = context
        self._key = LINKS.key(context.robot, self._service)
        self._links = InboxLinks(self._service, self._configured, context.inbox)
        self._initial = {change.topic: change for change in self._links.initial()}
        now = time.monotonic_ns()
        self._ask_at = [now + round(1e9 * after) for after in ASK_AT_S]
        self._queryable = context.session.declare_queryable(
            self._key, self._receive, complete=True, allowed_origin=zenoh.Locality.REMOTE
        )
        self.poll(now)

    def poll(self, now_ns: int) -> None:
        """Answer one query, take over one peer's answer, ask the peers, publish changes."""
        if self._answers:
            self._adopt(self._answers.popleft())
        if self._queries:
            self._answer(self._queries.popleft())
        if self._ask_at and now_ns >= self._ask_at[0]:
            del self._ask_at[0]
            self._ask_peers()
        if now_ns >= self._publish_at:
            self._publish(now_ns)
        self.due_ns = min(
            self._ask_at[0] if self._ask_at else NEVER,
            self._publish_at if self._initial or self._changes else NEVER,
        )
        # What came in meanwhile must not wait for a time computed before.
        if self._queries or self._answers:
            self.due_ns = 0

    def close(self) -> None:
        """Stop answering."""
        if self._queryable is None:
            return
        self._queryable.undeclare()
        while self._queries:
            self._refuse(self._queries.popleft(), f"{self._service} is ending")

    def _receive(self, query: Any) -> None:
        """Queue a query (a thread of the transport)."""
        if len(self._queries) >= _MAX_WAITING:
            self._refuse(query, "too many requests at once; try again")
            return
        self._queries.append(query)
        self.due_ns = 0
        self._context.inbox.wake()

    def _answer(self, query: Any) -> None:
        """Reply to a query, with an error in words if it asks for something impossible."""
        try:
            payload = query.payload.to_bytes() if query.payload is not None else b""
            if payload:
                self._set(from_wire(payload, LiveLinks))
            inputs = self._links.rows()
            reply = to_wire(LinkReply(service=self._service, inputs=inputs, live=self._links.live))
        except LinkControlError as error:
            self._refuse(query, f"{self._service}: {error}")
            return
        except Exception as error:  # noqa: BLE001 - no query may end a service
            _log.exception("%s failed on a query about its links", self._service)
            self._refuse(query, f"{self._service} failed: {type(error).__name__}: {error}")
            return
        try:
            with query:
                query.reply(self._key, reply)
        except zenoh.ZError as error:
            _log.warning("%s cannot answer about its links: %s", self._service, error)

    def _set(self, live: LiveLinks) -> None:
        """Put a client's links in force.

        Raises:
            LinkControlError: another change was made that the client does not know.
        """
        known = self._links.live.version
        if live.replaces < known or live.version <= known:
            raise LinkControlError(
                f"the change was made from version {live.replaces} of the live links, but version "
                f"{known} is in force; read the links again and repeat the change"
            )
        self._apply(live, "request")

    def _adopt(self, answer: bytes) -> None:
        """Take over the live links of a peer if they are newer."""
        try:
            self._apply(from_wire(answer, LinkReply).live, "peer")
        except LinkControlError as error:
            _log.warning("a peer's answer about links is not understood: %s", error)

    def _apply(self, live: LiveLinks, reason: str) -> None:
        for change in self._links.apply(live, reason):
            _log.info(
                "%s: link of input %s: %s, was %s (%s)",
                self._service,
                change.topic,
                change.link or "none",
                change.previous or "none",
                reason,
            )
            self._changes.append(change)

    def _ask_peers(self) -> None:
        """Query every peer for its live links; the answers come into a queue."""
        try:
            self._context.session.get(
                LINKS.key(self._context.robot, "*"),
                self._hear,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_QUERY_TIMEOUT_S,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        except zenoh.ZError as error:
            _log.warning("%s cannot ask its peers about links: %s", self._service, error)

    def _hear(self, reply: Any) -> None:
        """Queue a peer's answer (a thread of the transport)."""
        if reply.ok is not None:
            self._answers.append(reply.ok.payload.to_bytes())
            self.due_ns = 0

    def _publish(self, now_ns: int) -> None:
        """Publish pending changes once a subscriber exists."""
        self._publish_at = now_ns + _RETRY_NS
        context = self._context
        if not (self._initial or self._changes) or not context.wanted(LINK_CHANGE):
            return
        if self._initial and not self._repeat_at:
            self._repeat_at = [now_ns + round(1e9 * after) for after in _REPEAT_S]
        if self._initial and now_ns >= self._repeat_at[0]:
            del self._repeat_at[0]
            for change in self._initial.values():
                context.send(LINK_CHANGE, change)
            if not self._repeat_at:
                self._initial = {}
        while self._changes:
            change = self._changes.popleft()
            # A link that has changed is no longer the one of the start.
            self._initial.pop(change.topic, None)
            context.send(LINK_CHANGE, change)

    @staticmethod
    def _refuse(query: Any, text: str) -> None:
        try:
            with query:
                query.reply_err(text)
        except zenoh.ZError as error:
            _log.warning("cannot refuse a query about links: %s", error)
