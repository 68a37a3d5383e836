"""Filling in the headers of what is published."""

from collections.abc import Callable
from typing import Any

from common.schemas import Message


class HeaderStamper:
    """Fills headers of one publisher's messages: counts, and names the sender."""

    def __init__(self, source: str, boot: int, clock: Callable[[], int]) -> None:
        """Start at sequence number 0; ``clock`` gives ``sent`` [ns]."""
        self._source = source
        self._boot = boot
        self._clock = clock
        self.count = 0

    def next(self, message: Message, captured_ns: int = 0, started_ns: int = 0) -> dict[str, Any]:
        """Return the next header's fields, keeping the message's own ``stamp``.

        Args:
            message: its own ``captured`` is kept too, if it has one.
            captured_ns: otherwise this is taken.
            started_ns: when encoding it began; 0: it took no time.
        """
        header = message.header
        now = self._clock()
        fields = {
            "seq": self.count,
            "stamp": header.stamp,
            "captured": header.captured or captured_ns,
            "sent": now,
            "encode": now - started_ns if started_ns else 0,
            "boot": self._boot,
            "source": self._source,
            "injected": 0,
        }
        self.count += 1
        return fields
