"""Converts the times in messages from their senders' clocks to the recorder's.

Senders on the recorder's machine share its monotonic clock; those on other machines have clocks of
their own. A message cannot arrive before it was sent, and it takes far less than two seconds: a
sender that ever breaks one of the two has another clock. Services report how far the clocks of
their peers are off; without such a report, the arrival takes the place of the sending.
"""

from dataclasses import dataclass

from common.schemas import Header, Sender, ServiceHealth

LONGEST_TRANSPORT_NS = 2_000_000_000
"""The fastest message of a sender takes no longer than this, if its clock is the recorder's."""
_LONGEST_QUEUE_NS = 60_000_000_000
"""Sent, or captured before that, longer ago than this: the time is damaged [ns]."""


@dataclass(frozen=True, slots=True)
class Times:
    """When a message was captured, sent and recorded [ns], all on one clock."""

    stamp: int
    sent: int
    logged: int


class SenderClocks:
    """Learns from messages in the order of their arrival which clocks their senders have."""

    def __init__(self) -> None:
        """Start without any sender."""
        self._fastest: dict[Sender, int] = {}
        self._offsets: dict[str, int] = {}

    def learn(self, health: ServiceHealth) -> None:
        """Take in the clock offsets that a service on the recorder's machine reports."""
        if not self._is_shared(health.header.sender):
            return
        for peer in health.peers:
            if peer.clock_error >= 0.0:
                self._offsets[peer.source] = round(1e9 * peer.clock_offset)

    def times(self, header: Header, log_time: int) -> Times:
        """Return the times of a message that arrived at ``log_time``, on the recorder's clock [ns].

        The stamp is when its information was captured; without that, when it was sent.
        """
        sender = header.sender
        transport = log_time - header.sent
        if header.sent and transport < self._fastest.get(sender, _LONGEST_QUEUE_NS):
            self._fastest[sender] = transport
        sent = log_time
        if self._is_shared(sender) and transport <= _LONGEST_QUEUE_NS:
            sent = header.sent
        elif header.sent and sender.source in self._offsets:
            converted = header.sent + self._offsets[sender.source]
            if log_time - _LONGEST_QUEUE_NS <= converted:
                sent = min(converted, log_time)
        age = header.sent - header.captured if header.sent and header.captured else 0
        stamp = sent - age if abs(age) <= _LONGEST_QUEUE_NS else sent
        return Times(stamp, sent, log_time)

    def _is_shared(self, sender: Sender) -> bool:
        """Return whether a sender has the recorder's clock, by its messages so far."""
        return 0 <= self._fastest.get(sender, -1) <= LONGEST_TRANSPORT_NS
