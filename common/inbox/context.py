"""What the buffers of an inbox share: clock offsets, journal, and the judgement of ages."""

from collections import OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field

from common.journal.journal import Journal
from common.journal.tables import UNKNOWN
from common.schemas import Header, Sender

NO_LIMIT = 2**63
"""A largest age that no message reaches [ns]."""
GRACE_NS = 2_000_000_000
"""How long a sender whose clock is not known is trusted to send nothing old [ns]. The clocks of
those that answer are known within half a second."""
_MAX_SENDERS = 64


def _same_clock(_header: Header) -> int:
    return 0


@dataclass(frozen=True)
class InboxContext:
    """What the buffers of an inbox share.

    Attributes:
        offset_of: returns this clock minus that of the sender of a message [ns]; :data:`UNKNOWN`
            if not known.
        clock: to time the decoding with [ns]; None: not timed.
        journal: records every message that is taken in.
    """

    offset_of: Callable[[Header], int] = _same_clock
    clock: Callable[[], int] | None = None
    journal: Journal | None = None
    _unknown_since: "OrderedDict[Sender, int]" = field(default_factory=OrderedDict)
    """First arrival from each sender whose clock is not known [ns]."""

    def is_too_old(self, header: Header, offset: int, arrived_ns: int, max_age_ns: int) -> bool:
        """Return whether a message was too old when it arrived, or must be taken to be.

        A sender's clock is not known before it has answered, and never if it answers no clock
        queries, as a browser or a host behind access control. Then the age of its messages cannot
        be told. After a grace time only those are taken that are young if the sender shares this
        clock, as every process of this host does.

        Args:
            header: of the message.
            offset: this clock minus its sender's [ns]; UNKNOWN if not known.
            arrived_ns: when it arrived, injected delay left out [ns].
            max_age_ns: largest age to be applied, less than NO_LIMIT [ns].
        """
        if offset != UNKNOWN and header.sent:
            return arrived_ns - header.sent - offset > max_age_ns
        known = self._unknown_since
        since = known.setdefault(header.sender, arrived_ns)
        if len(known) > _MAX_SENDERS:
            known.popitem(last=False)
        return arrived_ns - since > GRACE_NS and not 0 <= arrived_ns - header.sent <= max_age_ns


class FollowedSender:
    """Follows one sender of a topic until it is silent; tells which messages are another's."""

    def __init__(self, silence_ns: int) -> None:
        """Follow nobody yet; a sender is given up after ``silence_ns`` [ns] without a message."""
        self.sender: Sender | None = None
        self._silence_ns = silence_ns
        self._heard_ns = 0

    def takes(self, header: Header, arrived_ns: int, *, old: bool = False) -> bool:
        """Return whether a message is that of the sender followed.

        The first sender heard is followed, and after its silence the next one.

        Args:
            header: of the message.
            arrived_ns: when it arrived, injected delay left out: a link's jitter is no silence.
            old: it was too old on arrival, so nobody is followed because of it.
        """
        followed = self.sender
        if followed is None or header.boot != followed.boot or header.source != followed.source:
            silent = followed is None or arrived_ns - self._heard_ns > self._silence_ns
            if old or not silent:
                return False
            self.sender = header.sender
        self._heard_ns = max(self._heard_ns, arrived_ns)
        return True
