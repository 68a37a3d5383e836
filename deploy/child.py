"""Run a module as this process's main program, tied to the life of the supervisor.

``python -m deploy.child <supervisor pid> <module> [args]``. The tie is made here, inside the new
process, because running Python between fork and exec is unsafe once the supervisor has threads.

``python -m deploy.child --spare <supervisor pid> <module> [args]`` imports the module in advance
and runs it as soon as a line arrives on the standard input, so that the successor of a service
that died needs no time for its imports. It ends when the input is closed without a line.
"""

import contextlib
import ctypes
import os
import runpy
import signal
import sys
from importlib import import_module
from importlib.util import find_spec

PR_SET_PDEATHSIG = 1
"""From linux/prctl.h: the signal a process gets when its parent dies."""
SPARE = "--spare"
"""Option of a process that waits to be needed."""
USAGE = f"usage: python -m deploy.child [{SPARE}] <supervisor pid> <module> [args]"


def tie_to_parent(parent: int) -> None:
    """Have the kernel kill this process when ``parent`` dies, however it dies.

    Only Linux offers this; elsewhere the supervisor's own clean-up is all there is.

    Raises:
        SystemExit: the parent was gone before the tie was made.
    """
    if sys.platform != "linux":
        return
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.prctl(PR_SET_PDEATHSIG, signal.SIGKILL, 0, 0, 0) != 0:
        sys.exit(f"deploy.child: prctl failed: {os.strerror(ctypes.get_errno())}")
    if os.getppid() != parent:
        sys.exit("deploy.child: the supervisor ended while this process was starting")


def preload(module: str) -> None:
    """Import what ``python -m module`` imports, without running it.

    Errors are left to the real run, which reports them.
    """
    with contextlib.suppress(Exception, SystemExit):
        spec = find_spec(module)
        is_package = spec is not None and spec.submodule_search_locations is not None
        name = f"{module}.__main__" if is_package else module
        import_module(name)
        # The main module itself is loaded again, under the name __main__.
        del sys.modules[name]


def wait_until_needed() -> None:
    """Wait for a line on the standard input, and give the input up then.

    Raises:
        SystemExit: the input was closed without a line, since no successor is wanted any more.
    """
    if not sys.stdin.buffer.readline():
        sys.exit(0)
    nothing = os.open(os.devnull, os.O_RDONLY)
    os.dup2(nothing, sys.stdin.fileno())
    os.close(nothing)


def main() -> None:
    """Read the command line, tie this process to its supervisor and become the module."""
    arguments = sys.argv[1:]
    is_spare = arguments[:1] == [SPARE]
    if is_spare:
        del arguments[0]
    if len(arguments) < 2:
        sys.exit(USAGE)
    parent, module = int(arguments[0]), arguments[1]
    tie_to_parent(parent)
    # A background process started by a shell ignores SIGINT, and so would its children; the
    # supervisor's first request to stop is a SIGINT.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = [module, *arguments[2:]]
    try:
        if is_spare:
            preload(module)
            wait_until_needed()
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except KeyboardInterrupt:
        sys.exit(f"{module}: stopped while it was starting")


if __name__ == "__main__":
    main()
