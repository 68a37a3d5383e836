"""Notice another process that is the same service, or another plant of the same robot.

Heartbeats tell: whoever is alive beats under the key of its name. A service that publishes
exclusive topics must not be doubled, so the newcomer of two such ends itself, for good. The other
has to answer its clock query first: heartbeats may still be under way when their sender is gone,
and a restart must not be refused because of them. Two that have both been running for a while, in
parts of a network that were cut off from each other, warn and go on: which of them is wanted only
a person knows. Readers follow one of them meanwhile; see :class:`common.topics.Topic`.
"""

import logging
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import zenoh

from common import queries
from common.errors import SchemaError
from common.ports import Role, with_role
from common.runtime.live.clock_sync import unpack_answer
from common.runtime.live.components import Component, RunnerContext
from common.schemas import Heartbeat
from common.topics import HEARTBEAT
from common.transport.keys import is_wildcard, key_of
from common.transport.session import tag_of
from common.wire.codec import decode

_log = logging.getLogger(__name__)

NEWCOMER_NS = 5_000_000_000
"""A service that has run for less than this ends if it finds another that has run for longer."""
_GONE_NS = 1_000_000_000
"""Silence after which the other is gone [ns]."""
_ASK_AGAIN_NS = 500_000_000
_WARN_AGAIN_NS = 10_000_000_000
_POLL_S = 0.01
_MAX_RIVALS = 16


def names_of_one(service: str) -> tuple[str, ...]:
    """Return the names that one robot may have once only: the service's own, or those of plants."""
    plants = with_role(Role.PLANT)
    return plants if service in plants else (service,)


@dataclass
class Rival:
    """Another process in the place of this one.

    Attributes:
        source, boot: of its messages.
        began_ns: when it started, on this clock [ns].
        heard_ns: when its last heartbeat arrived [ns].
        answers: it has answered a query.
    """

    source: str
    boot: int
    began_ns: int
    heard_ns: int
    answers: bool = False
    asked_ns: int = 0
    warned_ns: int = 0

    def __str__(self) -> str:
        up = 1e-9 * (self.heard_ns - self.began_ns)
        return f"another {self.source} (boot {self.boot:x}, up {up:.1f} s)"


@dataclass
class Rivals:
    """Decides whether this process is the newcomer of two. Pure.

    Attributes:
        boot: of this process.
        began_ns: when it started [ns].
        yields: whether it ends itself as the newcomer.
        by_boot: the others that are alive.
    """

    boot: int
    began_ns: int
    yields: bool
    by_boot: dict[int, Rival] = field(default_factory=dict)

    def hear(self, source: str, boot: int, uptime_ns: int, arrival_ns: int) -> None:
        """Note a heartbeat of a process that has run for ``uptime_ns``."""
        if boot == self.boot:
            return
        rival = self.by_boot.get(boot)
        if rival is not None:
            rival.heard_ns = arrival_ns
        elif len(self.by_boot) < _MAX_RIVALS:
            self.by_boot[boot] = Rival(source, boot, arrival_ns - uptime_ns, arrival_ns)

    def answer(self, boot: int) -> None:
        """Note that a process has answered a query."""
        if (rival := self.by_boot.get(boot)) is not None:
            rival.answers = True

    def forget_silent(self, now_ns: int) -> list[Rival]:
        """Remove and return those that are not alive any more."""
        gone = [each for each in self.by_boot.values() if now_ns - each.heard_ns > _GONE_NS]
        for rival in gone:
            del self.by_boot[rival.boot]
        return gone

    def older(self, now_ns: int) -> Rival | None:
        """Return the one that this process has to give way to; None if it stays."""
        if not self.yields or now_ns - self.began_ns > NEWCOMER_NS:
            return None
        # Delay makes the other seem younger, to both sides: never do both end.
        alive = (each for each in self.by_boot.values() if each.answers)
        return next((each for each in alive if each.began_ns < self.began_ns), None)


class Identity(Component):
    """Watches for another process in the place of this one.

    Attributes:
        refusal: why this process ends, in words; empty as long as it does not.
    """

    def __init__(self, service: str, *, exclusive: bool, stop: Callable[[], None]) -> None:
        """Prepare.

        Args:
            service: its name.
            exclusive: it must not be doubled, so the newcomer ends.
            stop: called once when this process is to end.
        """
        self.refusal = ""
        self._service, self._exclusive, self._stop = service, exclusive, stop
        self._heard: deque[tuple[int, bytes, str]] = deque(maxlen=64)
        self._answers: deque[bytes] = deque(maxlen=64)
        self._subscribers: list[Any] = []
        self._context: RunnerContext
        self._rivals: Rivals

    def open(self, context: RunnerContext) -> None:
        """Listen to heartbeats under the names that only one may have."""
        self._context = context
        self._rivals = Rivals(context.boot, time.monotonic_ns(), self._exclusive)
        self._subscribers = [
            context.session.declare_subscriber(
                key_of(context.robot, HEARTBEAT, name),
                self._receive,
                allowed_origin=zenoh.Locality.REMOTE,
            )
            for name in names_of_one(self._service)
        ]

    def listen(self, seconds: float) -> None:
        """Look for another for ``seconds`` before anything is published, or until it must end."""
        end = time.monotonic() + seconds
        while time.monotonic() < end and not self.refusal:
            self.poll(time.monotonic_ns())
            time.sleep(_POLL_S)

    def poll(self, now_ns: int) -> None:
        """Process what was heard; ask, warn, or end this process."""
        rivals = self._rivals
        while self._heard:
            self._hear(*self._heard.popleft())
        while self._answers:
            answer = unpack_answer(self._answers.popleft())
            if answer is not None:
                rivals.answer(answer.boot)
        if not rivals.by_boot:
            return
        for gone in rivals.forget_silent(now_ns):
            _log.info("%s: %s is gone", self._service, gone)
        older = rivals.older(now_ns)
        if older is not None and not self.refusal:
            self.refusal = (
                f"{self._service}: {older} is running on the bus of {self._context.robot}, so this "
                "one ends; expected one for each robot: stop the other first, or give this robot "
                "a name (TRILL_ROBOT) or a bus of its own"
            )
            self._stop()
        for rival in rivals.by_boot.values():
            if not rival.answers and now_ns >= rival.asked_ns + _ASK_AGAIN_NS:
                rival.asked_ns = now_ns
                self._ask(rival.source)
            # A newcomer may still end; until then nobody needs to be told.
            settled = now_ns - max(rival.began_ns, rivals.began_ns) > NEWCOMER_NS
            if settled and now_ns >= rival.warned_ns + _WARN_AGAIN_NS:
                rival.warned_ns = now_ns
                _log.warning("%s: %s is on the bus too; stop one", self._service, rival)

    def report(self) -> dict[str, Any]:
        """Return who else is there."""
        return {"conflict": "; ".join(map(str, self._rivals.by_boot.values()))[:200]}

    def close(self) -> None:
        """Stop listening."""
        for subscriber in self._subscribers:
            subscriber.undeclare()

    def _receive(self, sample: Any) -> None:
        """Queue a heartbeat (a thread of the transport)."""
        if not is_wildcard(str(sample.key_expr)):
            arrived = time.monotonic_ns(), sample.payload.to_bytes(), tag_of(sample.encoding)
            self._heard.append(arrived)

    def _hear(self, arrival_ns: int, payload: bytes, tag: str) -> None:
        try:
            beat = decode(payload, Heartbeat, tag or None)
        except SchemaError:
            return
        header = beat.header
        self._rivals.hear(header.source, header.boot, round(1e9 * beat.uptime), arrival_ns)

    def _ask(self, source: str) -> None:
        """Ask everybody of a name for a sign of life; the answers come into a queue."""

        def receive(reply: Any) -> None:
            if reply.ok is not None:
                self._answers.append(reply.ok.payload.to_bytes())

        try:
            self._context.session.get(
                queries.CLOCK.key(self._context.robot, source),
                receive,
                target=zenoh.QueryTarget.ALL,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=1.0,
                allowed_destination=zenoh.Locality.REMOTE,
            )
        except zenoh.ZError as error:
            _log.debug("cannot ask %s whether it is there: %s", source, error)
