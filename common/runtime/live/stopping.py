"""Asked to end: SIGINT and SIGTERM as a flag that a loop looks at."""

import signal
from types import FrameType


class StopSignals:
    """Sets ``asked`` on SIGINT and SIGTERM, without interrupting what is being done."""

    def __init__(self) -> None:
        self.asked = False

    def heed(self) -> "StopSignals":
        """Take over both signals; only possible in the main thread.

        Returns:
            itself.

        Raises:
            ValueError: this is not the main thread.
        """
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._note)
        return self

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        # Nothing that takes a lock: the interrupted code may hold it.
        self.asked = True
