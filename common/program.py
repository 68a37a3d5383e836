"""Run a program's work and put every expected end into words and an exit code."""

import contextlib
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from time import monotonic

from common.errors import TrillError, report

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 plus the number of SIGINT."""
BROKEN_PIPE = 141
"""Exit code when the reader of standard output has gone: 128 plus the number of SIGPIPE."""
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that ask a program to end: Ctrl-C, a service manager, a terminal that closes."""
_AT_ONCE = 1.0
"""Signals within this time are one: ``timeout`` signals a process, then its group [s]."""


@contextlib.contextmanager
def signals_as_keyboard_interrupt() -> Iterator[None]:
    """Raise KeyboardInterrupt at each of :data:`ENDING`, so that the process cleans up.

    SIGINT is among them because a background process of a shell script ignores it from the start;
    SIGHUP stays ignored where ``nohup`` wants it so. Outside the main thread nothing is changed.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    raised = -_AT_ONCE

    def interrupt(_number: int, _frame: object) -> None:
        nonlocal raised
        if monotonic() - raised >= _AT_ONCE:
            raised = monotonic()
            raise KeyboardInterrupt

    numbers = [
        number
        for number in ENDING
        if number is not signal.SIGHUP or signal.getsignal(number) is not signal.SIG_IGN
    ]
    previous = {number: signal.signal(number, interrupt) for number in numbers}
    try:
        yield
    finally:
        for number, handler in previous.items():
            signal.signal(number, handler)


def run_program(name: str, work: Callable[[], int], stopped: str = "") -> int:
    """Run ``work`` as the program ``name``; return the exit code.

    Args:
        name: it begins every message.
        work: raises KeyboardInterrupt at Ctrl-C, SIGTERM and SIGHUP.
        stopped: what to say after these.

    Returns:
        what ``work`` returned; 1 for an error of this project, 2 for a wrong configuration or
        option, 130 after Ctrl-C, 141 if nobody reads standard output any more (``… | head``).
    """
    try:
        with signals_as_keyboard_interrupt():
            code = work()
        # Here and not at the interpreter's end, where a broken pipe could only be ignored.
        sys.stdout.flush()
    except TrillError as error:
        return report(name, error)
    except KeyboardInterrupt:
        if stopped:
            print(f"{name}: {stopped}", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # What is still buffered goes nowhere, instead of into an error at the interpreter's end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    return code
