"""Restores a terminal after a process that was killed and could not do it itself.

Run as a file by :mod:`services.teleop.keyboard.terminal`, with as little start-up as possible,
hence without any import from this project: ``guardian.py <attributes> <bytes>``, both Python
literals. It waits until its input ends. A process that leaves in order says so before; otherwise
the terminal on standard output gets the bytes and the attributes.
"""

import ast
import contextlib
import os
import signal
import sys
import termios

TERMINAL = 1


def main() -> None:
    """Wait for the end of the guarded process."""
    # What ends or stops the guarded process must not end the guardian first.
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGTTOU"):
        signal.signal(signal.Signals[name], signal.SIG_IGN)
    if os.read(0, 1):
        return
    attributes, farewell = (ast.literal_eval(argument) for argument in sys.argv[1:3])
    with contextlib.suppress(OSError, termios.error):
        # A shell that has the terminal back already set it as it wants it.
        if os.tcgetpgrp(TERMINAL) == os.getpgrp():
            termios.tcsetattr(TERMINAL, termios.TCSANOW, attributes)
        os.write(TERMINAL, farewell)


if __name__ == "__main__":
    main()
