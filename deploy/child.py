"""Run a module as this process's main program, tied to the life of the supervisor.

``python -m deploy.child <supervisor pid> <module> [args]``. The tie is made here, inside the new
process, because running Python between fork and exec is unsafe once the supervisor has threads.
"""

import ctypes
import os
import runpy
import signal
import sys

PR_SET_PDEATHSIG = 1
"""From linux/prctl.h: the signal a process gets when its parent dies."""


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


def main() -> None:
    """Read the command line, tie this process to its supervisor and become the module."""
    if len(sys.argv) < 3:
        sys.exit("usage: python -m deploy.child <supervisor pid> <module> [args]")
    parent, module = int(sys.argv[1]), sys.argv[2]
    tie_to_parent(parent)
    # A background process started by a shell ignores SIGINT, and so would its children; the
    # supervisor's first request to stop is a SIGINT.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    sys.argv = [module, *sys.argv[3:]]
    try:
        runpy.run_module(module, run_name="__main__", alter_sys=True)
    except KeyboardInterrupt:
        sys.exit(f"{module}: stopped while it was starting")


if __name__ == "__main__":
    main()
