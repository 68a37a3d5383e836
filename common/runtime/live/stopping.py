"""Turn SIGINT and SIGTERM into a flag that a loop checks."""

import signal
from types import FrameType


class StopSignals:
    """Notes SIGINT and SIGTERM without interrupting the running code.

    Attributes:
        requested: whether one of them was received.
    """

    def __init__(self) -> None:
        self.requested = False

    def install(self) -> "StopSignals":
        """Install the handler of both signals; only possible in the main thread.

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
        self.requested = True
