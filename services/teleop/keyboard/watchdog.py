"""Terminal watchdog: restores the terminal after its process was killed.

:mod:`services.teleop.keyboard.terminal` runs it as a file, without any import from this project so
that it starts fast: ``watchdog.py <attributes> <bytes>``, both Python literals. It waits until its
input ends. A process that exits in order writes to it before; otherwise the watchdog writes the
bytes and the attributes to the terminal on standard output.
"""

import ast
import contextlib
import os
import signal
import sys
import termios

TERMINAL = 1


def main() -> None:
    """Wait for the end of the watched process."""
    # A signal that ends or stops the watched process must not end the watchdog first.
    for name in ("SIGINT", "SIGTERM", "SIGHUP", "SIGQUIT", "SIGTSTP", "SIGTTOU"):
        signal.signal(signal.Signals[name], signal.SIG_IGN)
    if os.read(0, 1):
        return
    attributes, farewell = (ast.literal_eval(argument) for argument in sys.argv[1:3])
    with contextlib.suppress(OSError, termios.error):
        # If the shell has the terminal back, it has set its own attributes.
        if os.tcgetpgrp(TERMINAL) == os.getpgrp():
            termios.tcsetattr(TERMINAL, termios.TCSANOW, attributes)
        os.write(TERMINAL, farewell)


if __name__ == "__main__":
    main()
