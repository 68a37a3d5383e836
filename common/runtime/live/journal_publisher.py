"""Publishes the journal of a live service."""

from collections import deque

from common.journal.journal import PERIOD_NS, Journal
from common.runtime.live.components import Component, RunnerContext
from common.schemas import StepJournal
from common.topics import JOURNAL

_KEPT = 240
"""Messages kept that nobody has heard: a minute. More would make collecting garbage slower."""
_KEPT_BYTES = 16_000_000
"""Likewise."""
_AT_ONCE_BYTES = 200_000
_AT_ONCE = 8
"""Messages of a backlog sent between two steps, unless these bytes are reached before."""


class JournalPublisher(Component):
    """Sends what a service took in, a few times a second, as long as somebody listens.

    Until then it is kept, so that a logger which connects a little later has a service's life
    from its first step; too much is given up from the oldest. It is kept and later sent in the
    small messages it would have been sent in: minutes in one piece would stop the loop for tenths
    of a second.
    """

    writes = (JOURNAL,)

    def __init__(self, journal: Journal) -> None:
        """Serve ``journal``."""
        self._journal = journal
        self._context: RunnerContext | None = None
        self._due = 0
        self._waiting: deque[StepJournal] = deque()
        self._waiting_bytes = 0

    def open(self, context: RunnerContext) -> None:
        """Remember where to send."""
        self._context = context

    def poll(self, now_ns: int) -> None:
        """Send what there is, if it is time."""
        if now_ns >= self._due:
            self._due = now_ns + PERIOD_NS
            self._collect()
            if self._context is not None and self._context.wanted(JOURNAL):
                self._send(self._context, _AT_ONCE, _AT_ONCE_BYTES)

    def close(self) -> None:
        """Send the rest."""
        self._collect()
        if self._context is not None and self._context.wanted(JOURNAL):
            self._send(self._context, len(self._waiting), self._waiting_bytes)

    def _collect(self) -> None:
        """Put what was taken in since the last time with what waits."""
        message = self._journal.fetch()
        if message is not None:
            self._waiting.append(message)
            self._waiting_bytes += _size(message)
        while len(self._waiting) > _KEPT or self._waiting_bytes > _KEPT_BYTES:
            self._waiting_bytes -= _size(self._waiting.popleft())

    def _send(self, context: RunnerContext, count: int, size: int) -> None:
        while self._waiting and count > 0 and size >= 0:
            message = self._waiting.popleft()
            self._waiting_bytes -= _size(message)
            count, size = count - 1, size - _size(message)
            context.send(JOURNAL, message)


def _size(message: StepJournal) -> int:
    return len(message.steps) + len(message.takes) + len(message.payloads)
