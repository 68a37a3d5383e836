"""Publish the journal of a live service."""

from collections import deque

from common.journal.journal import PERIOD_NS, Journal
from common.runtime.live.components import Component, RunnerContext
from common.schemas import StepJournal
from common.topics import JOURNAL

_MAX_WAITING = 240
"""Messages kept while there is no subscriber: a minute. More would slow down collecting garbage."""
_MAX_WAITING_BYTES = 16_000_000
"""The same in bytes."""
_BATCH = 8
"""Messages of a backlog sent between two steps."""
_BATCH_BYTES = 200_000
"""The same in bytes; reached first, it ends the batch."""


class JournalPublisher(Component):
    """Sends the journal a few times a second while there is a subscriber.

    Until there is one, messages are kept, so that a logger that connects a little later gets a
    service's run from its first step; of too many the oldest are dropped. The backlog is sent in
    the small messages it was collected in: minutes in one piece would stop the loop for tenths of
    a second.
    """

    writes = (JOURNAL,)

    def __init__(self, journal: Journal) -> None:
        """Publish ``journal``."""
        self._journal = journal
        self._context: RunnerContext | None = None
        self._due = 0
        self._waiting: deque[StepJournal] = deque()
        self._waiting_bytes = 0

    def open(self, context: RunnerContext) -> None:
        """Remember where to send."""
        self._context = context

    def poll(self, now_ns: int) -> None:
        """Collect and send, if it is time."""
        if now_ns >= self._due:
            self._due = now_ns + PERIOD_NS
            self._collect()
            if self._context is not None and self._context.wanted(JOURNAL):
                self._send(self._context, _BATCH, _BATCH_BYTES)

    def close(self) -> None:
        """Send the rest."""
        self._collect()
        if self._context is not None and self._context.wanted(JOURNAL):
            self._send(self._context, len(self._waiting), self._waiting_bytes)

    def _collect(self) -> None:
        """Append the journal's new rows to the backlog and drop what is too much of it."""
        message = self._journal.fetch()
        if message is not None:
            self._waiting.append(message)
            self._waiting_bytes += _size(message)
        while len(self._waiting) > _MAX_WAITING or self._waiting_bytes > _MAX_WAITING_BYTES:
            self._waiting_bytes -= _size(self._waiting.popleft())

    def _send(self, context: RunnerContext, count: int, size: int) -> None:
        while self._waiting and count > 0 and size >= 0:
            message = self._waiting.popleft()
            self._waiting_bytes -= _size(message)
            count, size = count - 1, size - _size(message)
            context.send(JOURNAL, message)


def _size(message: StepJournal) -> int:
    return len(message.steps) + len(message.inputs) + len(message.payloads)
