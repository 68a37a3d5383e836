"""Publishes the journal of a live service."""

from common.bus.journal import Journal
from common.runtime.aides import Aide, Place
from common.topics import JOURNAL

PERIOD_NS = 250_000_000
"""Between journal messages [ns]."""


class Journaling(Aide):
    """Sends what a service took in, a few times a second, as long as somebody listens.

    Until then it is kept, so that a logger which connects a little later has a service's life
    from its first step.
    """

    writes = (JOURNAL,)

    def __init__(self, journal: Journal) -> None:
        """Serve ``journal``."""
        self._journal = journal
        self._place: Place | None = None
        self._due = 0

    def open(self, place: Place) -> None:
        """Remember where to send."""
        self._place = place

    def tend(self, now_ns: int) -> None:
        """Send what there is, if it is time."""
        if now_ns >= self._due:
            self._due = now_ns + PERIOD_NS
            self._send()

    def close(self) -> None:
        """Send the rest."""
        self._send()

    def _send(self) -> None:
        place = self._place
        if place is None:
            return
        if not place.wanted(JOURNAL):
            self._journal.trim()
            return
        message = self._journal.fetch()
        if message is not None:
            place.send(JOURNAL, message)
