"""Declare supervised processes and report how they ended."""

import os
import signal
from dataclasses import dataclass
from pathlib import Path

TAIL_LINES = 12
"""Log lines quoted when a service dies."""


@dataclass(frozen=True)
class ProcessSpec:
    """Declares one process.

    Attributes:
        name: short name; its log file is ``<name>.txt``.
        module: run as ``python -m <module>``.
        args: command-line arguments.
        restart: whether it is started again after it failed, ``max_restarts`` times at most, unless
            its exit code says that it would end so again (:data:`common.errors.EXITS_FOR_GOOD`).
        max_restarts: how often it is started again.
        spare: whether a second process waits with the module already imported, so that a restart
            takes no time for imports. It costs the memory of the imported packages, and the import
            must have no side effects. It has no effect unless the process may be restarted.
        enabled: whether to start it at all.
        stop_order: processes with a lower number are stopped before those with a higher one.
        foreground: whether it owns the terminal (input, output, Ctrl-C) instead of a log file.
        may_finish: whether an end with exit code 0 is a success instead of a failure.
        essential: whether the system is of no use without it.
    """

    name: str
    module: str
    args: tuple[str, ...] = ()
    restart: bool = False
    max_restarts: int = 3
    spare: bool = False
    enabled: bool = True
    stop_order: int = 0
    foreground: bool = False
    may_finish: bool = False
    essential: bool = True


@dataclass(frozen=True)
class Exit:
    """Reports how a process ended on its own.

    Attributes:
        name: of the process.
        code: exit code, or the negative number of the signal that killed it.
        expected: whether it was allowed to finish and did so with code 0.
        restarted: whether it is running again.
        tail: the last lines of its log.
        essential: the system is of no use without it.
    """

    name: str
    code: int
    expected: bool
    restarted: bool
    tail: tuple[str, ...]
    essential: bool = True

    def describe(self) -> str:
        """Return a paragraph for the operator: name, exit code and last lines of the log."""
        lines = [f"{self.name} ended: {describe_code(self.code)}"]
        if self.restarted:
            lines[0] += "; started again"
        return "\n".join(lines + [f"    {line}" for line in self.tail])


def describe_code(code: int) -> str:
    """Return a process's return code in words."""
    if code >= 0:
        return f"exit code {code}"
    try:
        return f"killed by {signal.Signals(-code).name}"
    except ValueError:
        return f"killed by signal {-code}"


def tail(path: Path, lines: int = TAIL_LINES) -> tuple[str, ...]:
    """Return the last ``lines`` non-empty lines of a text file; none if there is no such file."""
    try:
        with path.open("rb") as stream:
            size = stream.seek(0, os.SEEK_END)
            stream.seek(max(0, size - 16384))
            text = stream.read().decode(errors="replace")
    except FileNotFoundError:
        return ()
    return tuple(line.rstrip() for line in text.splitlines() if line.strip())[-lines:]
