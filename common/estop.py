"""Emergency stop button: what it sends until the plant has confirmed the stop; pure.

Keyboard, headset and command line use the same one. The plant latches a stop, so sending it more
than once does no harm. It may therefore be sent so often that a link that loses half of all
messages does not delay it.
"""

from typing import Final

from common.repeat import next_due_ns
from common.schemas import Estop, GuardMode, Header, PlantStatus

BURST: Final = 8
"""Copies sent at once: with half of all messages lost, 99.6 % of the bursts arrive."""
LONGEST_POLL_PERIOD: Final = 0.05
"""Largest time between two calls of :meth:`StopButton.poll` [s]."""


class StopButton:
    """One button: pressed, it repeats the stop until a status of the plant confirms it.

    Not pressed, it says ten times a second that it is there. Nothing here ends a stop: that is
    :class:`~common.schemas.EstopClear`, a command of its own.

    Attributes:
        pressed_ns: when a stop was asked for that is not confirmed yet [ns]; None: none is open.
    """

    def __init__(self) -> None:
        self.pressed_ns: int | None = None
        self._reason = ""
        self._sent = False
        self._beat_due_ns = 0

    def press(self, reason: str, now_ns: int) -> None:
        """Ask for a stop, again if one is latched; ``now_ns`` is the time on any steady clock."""
        self._reason, self._sent = reason[:200], False
        if self.pressed_ns is None:
            self.pressed_ns = now_ns

    def poll(self, now_ns: int, heard: PlantStatus | None = None, stamp: int = 0) -> list[Estop]:
        """Return what to send now; call it at least every :data:`LONGEST_POLL_PERIOD`.

        Args:
            now_ns: time on the clock of :meth:`press`.
            heard: status of the plant that came since the last call; None: none did.
            stamp: last known robot time [ns].
        """
        # A status that came before the first copies were sent tells of an earlier stop.
        if self._sent and heard is not None and heard.guard is GuardMode.ESTOP:
            self.pressed_ns, self._sent = None, False
        header = Header(stamp=stamp)
        if self.pressed_ns is not None:
            self._sent = True
            return [Estop(header=header, reason=self._reason)] * BURST
        if now_ns < self._beat_due_ns:
            return []
        self._beat_due_ns = next_due_ns(now_ns)
        return [Estop(header=header, reason="", pressed=False)]
