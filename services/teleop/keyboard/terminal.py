"""The terminal: unbuffered keys, an alternate screen, and its restoration at every exit."""

import atexit
import contextlib
import os
import select
import subprocess
import sys
import tempfile
import termios
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any, Protocol

from services.teleop.errors import TerminalError

ENTER = b"\x1b[?1049h\x1b[?25l\x1b[?7l\x1b[2J"
"""Alternate screen, cursor hidden, long lines cut (xterm control sequences)."""
LEAVE = b"\x1b[?7h\x1b[?25h\x1b[?1049l"
WATCHDOG = Path(__file__).with_name("watchdog.py")
STDERR = 2


class Screen(Protocol):
    """Source of keys and target of the drawn lines."""

    def read(self) -> bytes | None:
        """Return the bytes typed since the last call, at once; None: the terminal is gone."""
        ...

    def draw(self, lines: Sequence[str]) -> None:
        """Draw ``lines`` from the top."""
        ...

    def close(self) -> None:
        """Restore the terminal; may be called again."""
        ...


class Terminal:
    r"""The terminal of this process, set up at the first use and restored by :meth:`close`.

    Ctrl-C still raises SIGINT; Ctrl-Z, Ctrl-\ and Ctrl-S, which would leave the robot without
    set-points, do nothing. Standard error would disturb the screen and be lost with it, so it is
    held back until :meth:`close`.
    """

    def __init__(self) -> None:
        """Check that there is a terminal.

        Raises:
            TerminalError: input or output is not a terminal.
        """
        self._input, self._output = sys.stdin.fileno(), sys.stdout.fileno()
        for stream, number in (("input", self._input), ("output", self._output)):
            if not os.isatty(number):
                raise TerminalError(
                    f"the keyboard operator needs a terminal as its {stream}, got a file or pipe; "
                    "run it in a terminal of its own, or use the scripted operator"
                )
        self._saved: list[Any] | None = None
        self._watchdog: subprocess.Popen[bytes] | None = None
        self._held_back: tuple[int, IO[bytes]] | None = None
        self._shown: tuple[os.terminal_size, list[str]] | None = None

    def read(self) -> bytes | None:
        """See :class:`Screen`."""
        self._open()
        if not select.select([self._input], [], [], 0)[0]:
            return b""
        try:
            return os.read(self._input, 4096) or None
        except OSError:
            return None

    def draw(self, lines: Sequence[str]) -> None:
        """See :class:`Screen`; nothing is drawn while the terminal does not accept output."""
        self._open()
        if not select.select([], [self._output], [], 0)[1]:
            return
        with contextlib.suppress(OSError):
            size = os.get_terminal_size(self._output)
            fitting = list(lines[: size.lines])
            known = self._shown[1] if self._shown is not None and self._shown[0] == size else []
            changes = [
                f"\x1b[{row + 1};1H{line}\x1b[0m\x1b[K"
                for row, line in enumerate(fitting)
                if row >= len(known) or known[row] != line
            ]
            os.write(self._output, "".join(changes).encode())
            self._shown = (size, fitting)

    def close(self) -> None:
        """See :class:`Screen`."""
        saved, self._saved = self._saved, None
        if saved is None:
            return
        atexit.unregister(self.close)
        # The terminal may not exist any more, as after a lost connection.
        with contextlib.suppress(OSError, termios.error):
            os.write(self._output, LEAVE)
            # Keys that were typed but not read must not go to the shell.
            termios.tcflush(self._input, termios.TCIFLUSH)
            termios.tcsetattr(self._input, termios.TCSANOW, saved)
        self._release_errors()
        if self._watchdog is not None:
            self._watchdog.communicate(b"left in order")

    def _open(self) -> None:
        if self._saved is not None:
            return
        saved = termios.tcgetattr(self._input)
        self._watchdog = subprocess.Popen(
            [sys.executable, "-I", "-S", str(WATCHDOG), repr(saved), repr(LEAVE)],
            stdin=subprocess.PIPE,
            stdout=self._output,
            stderr=subprocess.DEVNULL,
        )
        self._saved = saved
        atexit.register(self.close)
        self._hold_errors()
        mode = termios.tcgetattr(self._input)
        mode[0] &= ~termios.IXON
        mode[3] &= ~(termios.ICANON | termios.ECHO | termios.IEXTEN)
        mode[6][termios.VMIN], mode[6][termios.VTIME] = 1, 0
        disabled = bytes([os.fpathconf(self._input, "PC_VDISABLE")])
        mode[6][termios.VSUSP] = mode[6][termios.VQUIT] = disabled
        termios.tcsetattr(self._input, termios.TCSANOW, mode)
        os.write(self._output, ENTER)

    def _hold_errors(self) -> None:
        if os.isatty(STDERR):
            held = tempfile.TemporaryFile()  # noqa: SIM115 - lives until close()
            self._held_back = (os.dup(STDERR), held)
            os.dup2(held.fileno(), STDERR)

    def _release_errors(self) -> None:
        if self._held_back is None:
            return
        (original, held), self._held_back = self._held_back, None
        os.dup2(original, STDERR)
        os.close(original)
        with held, contextlib.suppress(OSError):
            held.seek(0)
            os.write(STDERR, held.read())
