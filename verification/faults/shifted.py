"""Runs a module with a monotonic clock that is off, or is set while it runs.

    python -m verification.faults.shifted --skew 0.2 -- services.sim --base-port 23000
    python -m verification.faults.shifted --skew -0.2 --namespace -- services.sim
    python -m verification.faults.shifted --step 0.15 --after 5 -- services.sim

With ``--namespace`` the process gets a Linux time namespace of its own (as root), so that the
kernel's clock itself is off; otherwise Python's ``time.monotonic_ns`` is replaced before anything
else is loaded, and the process passes for one of another host. The modules of this project that
stamp messages and answer pings all go by that function.
"""

import argparse
import ctypes
import os
import runpy
import secrets
import signal
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

_CLONE_NEWTIME = 0x80


def enter_time_namespace(skew_s: float) -> None:
    """Move to a time namespace whose monotonic clock is ahead by ``skew_s``; in the next program.

    Raises:
        OSError: the kernel cannot or this user may not.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWTIME) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"no time namespace: {os.strerror(number)} (root is needed)")
    seconds, nanoseconds = divmod(round(1e9 * skew_s), 1_000_000_000)
    Path("/proc/self/timens_offsets").write_text(f"monotonic {seconds} {nanoseconds}\n")


def shift_clock(skew_s: float, step_s: float, after_s: float) -> None:
    """Replace ``time.monotonic_ns`` and pass for another host.

    Args:
        skew_s: ahead by this much [s].
        step_s: and set ahead by this much [s] ...
        after_s: ... after this long [s], or on SIGUSR2.
    """
    true_clock = time.monotonic_ns
    skew, step = round(1e9 * skew_s), round(1e9 * step_s)
    turn = true_clock() + round(1e9 * after_s)

    def shifted() -> int:
        now = true_clock()
        return now + skew + (step if now >= turn else 0)

    def set_now(_number: int, _frame: FrameType | None) -> None:
        nonlocal turn
        turn = min(turn, true_clock())

    signal.signal(signal.SIGUSR2, set_now)

    time.monotonic_ns = shifted
    # Only now: much of it keeps a reference to the clock as it is when loaded.
    from common.runtime.live import clock_sync as clocks

    identity = secrets.token_bytes(16)
    clocks.clock_identity = lambda: identity


def main(argv: Sequence[str] | None = None) -> None:
    """Shift the clock and run the module in this process."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faults.shifted", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--skew", type=float, default=0.0, help="ahead by this much [s]")
    parser.add_argument("--step", type=float, default=0.0, help="set ahead by this much [s] ...")
    parser.add_argument(
        "--after", type=float, default=5.0, help="... after this long [s], or on SIGUSR2 before"
    )
    parser.add_argument("--namespace", action="store_true", help="by a Linux time namespace")
    parser.add_argument("module", help="and its arguments, after --")
    arguments, rest = parser.parse_known_args(argv)
    rest = [text for text in rest if text != "--"]
    if not arguments.namespace:
        shift_clock(arguments.skew, arguments.step, arguments.after)
    else:
        enter_time_namespace(arguments.skew)
        # Linux since 6.3 change over in exec; before, in the next child only.
        os.execv(sys.executable, [sys.executable, "-m", arguments.module, *rest])
    sys.argv = [arguments.module, *rest]
    runpy.run_module(arguments.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
