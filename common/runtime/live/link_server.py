"""Lets links be changed while a service runs, and tells which are in force."""

import logging
import time
from collections import deque
from typing import Any

import zenoh

from common.links.config import Links
from common.links.control import (
    Changed,
    LinkControlError,
    LinkReply,
    LinkRequest,
    LinkRow,
    LinkTable,
    from_wire,
    links_key,
    to_wire,
)
from common.links.spec import LinkSpec
from common.runtime.live.components import NEVER, Component, RunnerContext
from common.schemas import LinkChange
from common.topics import LINK_CHANGE

_log = logging.getLogger(__name__)

ASK_AT_S = (0.0, 0.5, 1.0, 2.0, 3.5, 5.0, 8.0)
"""When a new service asks its peers, after its start. The first answer is not the last word: it
may come from one that is as new and knows nothing yet."""
_REPEAT_S = (0.0, 3.0, 10.0)
"""When links in force from the start are told, after somebody first listens."""
_RETRY_NS = 250_000_000
_MAX_WAITING = 32
_MAX_TEXT = 200
_QUERY_TIMEOUT_S = 2.0


class LinkServer(Component):
    """Answers on ``<robot>/links/<service>``; see :mod:`common.links.control`.

    The transport's threads only queue what comes; it is read, applied and answered between two
    steps, one request and one answer at a time.
    """

    writes = (LINK_CHANGE,)

    def __init__(self, service: str, configured: Links) -> None:
        """Serve the inputs of ``service``, which starts with the links ``configured`` for it."""
        self._table = LinkTable(service, configured)
        self._context: RunnerContext | None = None
        self._requests: deque[Any] = deque()
        self._answers: deque[bytes] = deque(maxlen=_MAX_WAITING)
        self._applied: dict[str, LinkSpec | None] = {}
        self._untold: deque[LinkChange] = deque(maxlen=256)
        self._starts: tuple[LinkChange, ...] = ()
        self._repeats: list[int] = []
        self._ask_at: list[int] = []
        self._retry_at = 0

    def open(self, context: RunnerContext) -> None:
        """Answer from now on, and ask the others what was changed before."""
        self._context = context
        self._applied = {topic: self._table.of(topic) for topic in context.inbox.topics}
        self._starts = tuple(
            LinkChange(service=context.service, topic=topic, link=_words(spec), reason="start")
            for topic, spec in self._applied.items()
            if spec is not None
        )
        now = time.monotonic_ns()
        self._ask_at = [now + round(1e9 * after) for after in ASK_AT_S]
        self._queryable: Any = context.session.declare_queryable(
            links_key(context.robot, context.service),
            self._receive,
            complete=True,
            allowed_origin=zenoh.Locality.REMOTE,
        )
        self.poll(now)

    def poll(self, now_ns: int) -> None:
        """Answer one request, take in what peers said, ask them, tell changes."""
        context = self._context
        if context is None:
            return
        if self._answers:
            self._adopt(self._answers.popleft())
        if self._requests:
            self._answer(self._requests.popleft())
        if self._ask_at and now_ns >= self._ask_at[0]:
            del self._ask_at[0]
            self._ask(context)
        if now_ns >= self._retry_at:
            self._tell(context, now_ns)
        self.due_ns = self._next_due()
        # What came in meanwhile must not wait for a time computed before.
        if self._requests or self._answers:
            self.due_ns = 0

    def close(self) -> None:
        """Answer no more."""
        if self._context is None:
            return
        self._queryable.undeclare()
        while self._requests:
            self._refuse(self._requests.popleft(), f"{self._context.service} is ending")

    def _next_due(self) -> int:
        telling = self._untold or self._starts
        return min(self._ask_at[0] if self._ask_at else NEVER, self._retry_at if telling else NEVER)

    def _receive(self, query: Any) -> None:
        """Queue a request (a thread of the transport)."""
        context = self._context
        if context is None or len(self._requests) >= _MAX_WAITING:
            self._refuse(query, "too many requests at once; try again")
            return
        self._requests.append(query)
        self.due_ns = 0
        context.inbox.wake()

    def _answer(self, query: Any) -> None:
        """Do what a request asks for and reply, with an error in words if it cannot be done."""
        context = self._context
        assert context is not None
        try:
            payload = query.payload
            request = from_wire(payload.to_bytes() if payload else b"", LinkRequest)
            reply = to_wire(self._do(request, context))
        except LinkControlError as error:
            self._refuse(query, f"{context.service}: {error}")
            return
        except Exception as error:  # noqa: BLE001 - no request may end a service
            _log.exception("%s failed on a request about its links", context.service)
            self._refuse(query, f"{context.service} failed: {type(error).__name__}: {error}")
            return
        try:
            with query:
                query.reply(links_key(context.robot, context.service), reply)
        except zenoh.ZError as error:
            _log.warning("%s cannot answer about its links: %s", context.service, error)

    def _do(self, request: LinkRequest, context: RunnerContext) -> LinkReply:
        before = {topic: context.inbox.link_of(topic) for topic in context.inbox.topics}
        self._table.apply(request, time.time_ns())
        self._apply("request")
        concerned = self._table.concerned(request, context.inbox.topics)
        return LinkReply(
            service=context.service,
            changed=[
                Changed(topic=topic, previous=before[topic], link=context.inbox.link_of(topic))
                for topic in concerned
            ],
            inputs=[] if request.action == "peers" else _rows(context),
            live=self._table.entries,
        )

    def _apply(self, reason: str) -> None:
        """Put what the table says on the inputs; every change is told and logged."""
        context = self._context
        assert context is not None
        for topic, old in self._applied.items():
            new = self._table.of(topic)
            if new == old:
                continue
            previous = context.inbox.link_of(topic)
            context.inbox.set_link(topic, new)
            self._applied[topic] = new
            link = context.inbox.link_of(topic)
            _log.info(
                "%s: link of input %s: %s, was %s (%s)",
                context.service,
                topic,
                link or "none",
                previous or "none",
                reason,
            )
            self._untold.append(
                LinkChange(
                    service=context.service,
                    topic=topic,
                    link=link[:_MAX_TEXT],
                    previous=previous[:_MAX_TEXT],
                    reason=reason,
                )
            )

    def _ask(self, context: RunnerContext) -> None:
        """Ask every peer for the live changes; the answers come into a queue."""
        try:
            context.session.get(
                links_key(context.robot, "*"),
                self._hear,
                payload=to_wire(LinkRequest(action="peers")),
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=_QUERY_TIMEOUT_S,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        except zenoh.ZError as error:
            _log.warning("%s cannot ask its peers about links: %s", context.service, error)

    def _hear(self, reply: Any) -> None:
        """Queue a peer's answer (a thread of the transport)."""
        if reply.ok is not None:
            self._answers.append(reply.ok.payload.to_bytes())
            self.due_ns = 0

    def _adopt(self, answer: bytes) -> None:
        try:
            peers = from_wire(answer, LinkReply)
        except LinkControlError as error:
            _log.warning("a peer's answer about links is not understood: %s", error)
            return
        self._table.merge(peers.live)
        self._apply("peer")

    def _tell(self, context: RunnerContext, now_ns: int) -> None:
        """Publish what has not been told, once somebody listens."""
        self._retry_at = now_ns + _RETRY_NS
        if not (self._starts or self._untold) or not context.wanted(LINK_CHANGE):
            return
        if self._starts:
            if not self._repeats:
                self._repeats = [now_ns + round(1e9 * after) for after in _REPEAT_S]
            if now_ns >= self._repeats[0]:
                del self._repeats[0]
                for change in self._starts:
                    context.send(LINK_CHANGE, change)
                if not self._repeats:
                    self._starts = ()
        while self._untold:
            # What has changed since is no longer a link to be told as there from the start.
            change = self._untold.popleft()
            self._starts = tuple(c for c in self._starts if c.topic != change.topic)
            context.send(LINK_CHANGE, change)

    @staticmethod
    def _refuse(query: Any, text: str) -> None:
        try:
            with query:
                query.reply_err(text)
        except zenoh.ZError as error:
            _log.warning("cannot refuse a request about links: %s", error)


def _words(spec: LinkSpec | None) -> str:
    return "" if spec is None or spec == LinkSpec() else str(spec)[:_MAX_TEXT]


def _rows(context: RunnerContext) -> list[LinkRow]:
    stats = context.inbox.delay_stats()
    rows = []
    for topic in context.inbox.topics:
        link = context.inbox.link_of(topic)
        did = stats.get(topic)
        if did is None or not link:
            rows.append(LinkRow(topic=topic, link=link))
            continue
        rows.append(
            LinkRow(
                topic=topic,
                link=link,
                requested_mean=did.requested_mean,
                requested_p99=did.requested_p99,
                achieved_mean=did.achieved_mean,
                achieved_p99=did.achieved_p99,
                arrived=did.pushed,
                held_back=did.held_back,
                lost=did.lost,
            )
        )
    return rows
