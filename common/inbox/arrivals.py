"""Queue the payloads of one input between the transport's thread and the service's.

The transport's thread calls :meth:`ArrivalQueue.put` and nothing else. It always appends to the
same queue, so a link that the service's thread sets meanwhile cannot be bypassed.
"""

from collections import deque
from collections.abc import Callable
from typing import NamedTuple

from common.links.delay import DelayLine
from common.wire.header import wire_header

LATEST_BACKLOG = 32
"""Payloads of a latest-value topic kept for a service that does not read."""
EVENT_BACKLOG = 4096
"""The same for an event topic, where each one matters: a thousand at one instant are all kept."""
LINK_BACKLOG = 4096
"""The same in front of a delay line, which must see every arrival."""
WILDCARD = "*"
"""In the place of a tag: the message was put on a wildcard key, and is refused."""
NEVER = 2**63
"""A time out of reach [ns]."""


class RawMessage(NamedTuple):
    """A payload as it arrived (or fell due)."""

    arrival_ns: int
    payload: bytes
    tag: str | None
    """Schema tag of the sender; None if it is the reader's own."""
    injected_ns: int = 0


class ArrivalQueue:
    """Payloads that wait to be decoded, behind a delay line if there is a link.

    Attributes:
        ready: payloads to be decoded.
        line: delays arrivals; None: no link was ever set.
        skipped: payloads dropped because too many waited.
        last_put_ns: newest arrival [ns]; -1 before the first.
    """

    def __init__(self, *, is_event: bool) -> None:
        """Create an empty queue, longer for an event topic than for a latest-value one."""
        self._arrived: deque[RawMessage] = deque()
        """Filled by the transport's thread."""
        self._due: deque[RawMessage] = deque()
        """Filled from the delay line."""
        self.ready = self._arrived
        self._backlog = EVENT_BACKLOG if is_event else LATEST_BACKLOG
        self.line: DelayLine[RawMessage] | None = None
        self.skipped = 0
        self.last_put_ns = -1

    @property
    def next_due_ns(self) -> int:
        """When the next message held by the delay line falls due [ns]."""
        return NEVER if self.line is None else self.line.next_due_ns

    @property
    def next_release_ns(self) -> int:
        """No payload that has been put falls due before this time [ns]."""
        first = self.ready or self._arrived
        return min(first[0].arrival_ns if first else NEVER, self.next_due_ns)

    def put(self, payload: bytes, arrival_ns: int, tag: str | None) -> None:
        """Append a payload, dropping the oldest when too many wait (any one thread)."""
        arrived = self._arrived
        if len(arrived) >= self._backlog:
            self.skipped += _pop_oldest(arrived) is not None
        arrived.append(RawMessage(arrival_ns, payload, tag))
        if self.line is None:
            self.last_put_ns = arrival_ns

    def pop(self) -> RawMessage | None:
        """Remove and return the oldest that is ready; None if there is none."""
        return _pop_oldest(self.ready)

    def set_line(self, line: DelayLine[RawMessage]) -> None:
        """Put another delay line in front; from the first one on there is always one.

        Messages that the old line still holds fall due as they would have.
        """
        if self.line is not None:
            line.adopt(self.line)
        else:
            # What came before the first line is not delayed, what comes from now on is.
            for _ in range(len(self._arrived)):
                message = _pop_oldest(self._arrived)
                if message is not None:
                    self._due.append(message)
                    self.last_put_ns = message.arrival_ns
            self.ready = self._due
        self.line = line
        self._backlog = LINK_BACKLOG

    def release(self, now_ns: int, on_lost: Callable[[RawMessage], object]) -> bool:
        """Pass payloads through the delay line.

        Args:
            now_ns: until when they fall due.
            on_lost: called with each message that the link drops on purpose.

        Returns:
            whether any fell due.
        """
        line, arrived = self.line, self._arrived
        if line is None:
            return False
        # As many as wait now: more may come faster than they are processed.
        for _ in range(len(arrived)):
            message = _pop_oldest(arrived)
            if message is None:
                break
            stamp = None
            if line.by_time and (head := wire_header(message.payload)) is not None:
                stamp = head.stamp or None
            if not line.push(message, message.arrival_ns, stamp):
                on_lost(message)
        if line.next_due_ns > now_ns:
            return False
        for due_ns, injected_ns, message in line.pop(now_ns):
            self._due.append(RawMessage(due_ns, message.payload, message.tag, injected_ns))
            self.last_put_ns = due_ns
        return True


def _pop_oldest(queue: deque[RawMessage]) -> RawMessage | None:
    """Remove and return the oldest; None if the other thread has just removed the last."""
    try:
        return queue.popleft()
    except IndexError:
        return None
