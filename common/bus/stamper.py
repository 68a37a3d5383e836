"""Filling in the headers of what is published."""

from collections.abc import Callable

from common.schemas import Message


class HeaderStamper:
    """Fills headers of one publisher's messages: counts, and names the sender."""

    def __init__(self, source: str, boot: int, clock: Callable[[], int]) -> None:
        """Start at sequence number 0; ``clock`` gives ``sent`` [ns]."""
        self._source = source
        self._boot = boot
        self._clock = clock
        self.count = 0

    def next(self, message: Message) -> dict[str, int | str]:
        """Return the next header's fields, keeping the message's own ``stamp``."""
        header = message.header
        fields: dict[str, int | str] = {
            "seq": self.count,
            "stamp": header.stamp,
            "sent": self._clock(),
            "boot": self._boot,
            "source": self._source,
            "injected": 0,
        }
        self.count += 1
        return fields
