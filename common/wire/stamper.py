"""Complete the headers of the messages of one publisher."""

from collections.abc import Callable
from typing import Any

from common.schemas import Message


class HeaderStamper:
    """Numbers one publisher's messages and names their sender.

    Attributes:
        count: sequence number of the next message.
    """

    def __init__(self, source: str, boot: int, clock: Callable[[], int]) -> None:
        """Start at sequence number 0.

        Args:
            source: name of the sending service.
            boot: random id of its process.
            clock: returns the time of sending [ns].
        """
        self._source = source
        self._boot = boot
        self._clock = clock
        self.count = 0

    def next(self, message: Message, captured_ns: int = 0, started_ns: int = 0) -> dict[str, Any]:
        """Return the fields of the next header, keeping the message's own ``stamp``.

        Args:
            message: to be sent; its own ``captured`` is kept too, if it has one.
            captured_ns: otherwise this is used.
            started_ns: when encoding began; 0: encoding took no time.
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
