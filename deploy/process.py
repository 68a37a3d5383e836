"""What a supervised process is, and how its end is told."""

import contextlib
import os
import signal
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

TAIL_LINES = 12
"""Log lines quoted when a service dies."""


class Restart(Enum):
    """What to do when a process ends on its own."""

    NEVER = "never"
    ON_FAILURE = "on-failure"


@dataclass(frozen=True)
class ProcessSpec:
    """One process, declared.

    Attributes:
        name: short name; its log file is ``<name>.txt``.
        module: run as ``python -m <module>``.
        args: command-line arguments.
        restart: whether it is started again after it failed (at most ``max_restarts`` times).
        wanted: whether to start it at all.
        stop_order: processes of a lower wave are stopped before those of a higher one.
        foreground: owns the terminal (input, output, Ctrl-C) instead of a log file.
        may_finish: ending with exit code 0 is success, not a death.
        essential: the system is of no use without it.
    """

    name: str
    module: str
    args: tuple[str, ...] = ()
    restart: Restart = Restart.NEVER
    max_restarts: int = 3
    wanted: bool = True
    stop_order: int = 0
    foreground: bool = False
    may_finish: bool = False
    essential: bool = True


@dataclass(frozen=True)
class Exit:
    """How a process ended on its own.

    ``code`` is the exit code, negative for a signal; ``expected`` is true for a process that may
    finish and did so with code 0; ``restarted`` says whether it is running again.
    """

    name: str
    code: int
    expected: bool
    restarted: bool
    tail: tuple[str, ...]

    def describe(self) -> str:
        """One paragraph for a person: what ended, how, and what it said last."""
        lines = [f"{self.name} ended: {describe_code(self.code)}"]
        if self.restarted:
            lines[0] += "; started again"
        return "\n".join(lines + [f"    {line}" for line in self.tail])


def describe_code(code: int) -> str:
    """Words for a process's return code."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


def tail(path: Path, lines: int = TAIL_LINES) -> tuple[str, ...]:
    """Last ``lines`` non-empty lines of a text file; empty when there is no such file."""
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(0, size - 16384))
            text = stream.read().decode(errors="replace")
    except FileNotFoundError:
        return ()
    return tuple(line.rstrip() for line in text.splitlines() if line.strip())[-lines:]


_ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextlib.contextmanager
def terminated_as_interrupted() -> Iterator[None]:
    """Inside, SIGINT, SIGTERM and SIGHUP all raise KeyboardInterrupt, so that each cleans up.

    SIGINT too: a process started in the background by a shell script ignores it from birth.
    """

    def interrupt(_number: int, _frame: object) -> None:
        raise KeyboardInterrupt

    previous = {n: signal.signal(n, interrupt) for n in _ENDING}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)
