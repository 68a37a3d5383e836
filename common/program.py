"""Run a program's work and put every expected end into words and an exit code."""

import os
import sys
from collections.abc import Callable

from common.errors import TrillError, report

INTERRUPTED = 130
"""Exit code after Ctrl-C: 128 plus the number of SIGINT."""
BROKEN_PIPE = 141
"""Exit code when the reader of standard output has gone: 128 plus the number of SIGPIPE."""


def run_program(name: str, work: Callable[[], int]) -> int:
    """Run ``work`` as the program ``name``; return the exit code.

    Returns:
        what ``work`` returned; 1 for an error of this project, 2 for a wrong configuration or
        option, 130 after Ctrl-C, 141 if nobody reads standard output any more (``… | head``).
    """
    try:
        code = work()
        # Here and not at the interpreter's end, where a broken pipe could only be ignored.
        sys.stdout.flush()
    except TrillError as error:
        return report(name, error)
    except KeyboardInterrupt:
        return INTERRUPTED
    except BrokenPipeError:
        # What is still buffered goes nowhere, instead of into an error at the interpreter's end.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BROKEN_PIPE
    return code
