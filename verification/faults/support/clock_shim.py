"""Run a module with a monotonic clock that is ahead or behind, or that is set while it runs.

    python -m verification.faults.support.clock_shim --skew 0.2 -- services.sim --base-port 23000
    python -m verification.faults.support.clock_shim --skew -0.2 --namespace -- services.sim
    python -m verification.faults.support.clock_shim --step 0.15 --after 5 -- services.sim

With ``--namespace`` the process enters a Linux time namespace of its own (as root), so the
kernel's clock itself is shifted. Otherwise Python's ``time.monotonic_ns``, which every module of
this project uses to stamp messages and answer pings, is replaced before anything else is loaded,
and the process identifies itself as one of another host.
"""

import argparse
import ctypes
import os
import runpy
import secrets
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from types import FrameType

MODULE = "verification.faults.support.clock_shim"
_CLONE_NEWTIME = 0x80


def enter_time_namespace(skew_s: float) -> None:
    """Enter a time namespace whose monotonic clock is ahead by ``skew_s`` [s] after an exec.

    Raises:
        OSError: the kernel has no time namespaces or the user is not root.
    """
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.unshare(_CLONE_NEWTIME) != 0:
        number = ctypes.get_errno()
        raise OSError(number, f"no time namespace: {os.strerror(number)} (root is needed)")
    seconds, nanoseconds = divmod(round(1e9 * skew_s), 1_000_000_000)
    Path("/proc/self/timens_offsets").write_text(f"monotonic {seconds} {nanoseconds}\n")


def has_time_namespaces() -> bool:
    """Whether this kernel and this user can shift the kernel's clock."""
    text = f"from {MODULE} import enter_time_namespace; enter_time_namespace(1.0)"
    tried = subprocess.run([sys.executable, "-c", text], capture_output=True, check=False)
    return tried.returncode == 0


def shift_clock(skew_s: float, step_s: float, after_s: float) -> None:
    """Replace ``time.monotonic_ns`` and the identity of this host's clock.

    Args:
        skew_s: the clock is ahead by this much from the start [s].
        step_s: the clock is set forward by this much later [s].
        after_s: time of that step from now, unless SIGUSR2 comes before [s].
    """
    true_clock = time.monotonic_ns
    skew, step = round(1e9 * skew_s), round(1e9 * step_s)
    step_at = true_clock() + round(1e9 * after_s)

    def shifted() -> int:
        now = true_clock()
        return now + skew + (step if now >= step_at else 0)

    def step_now(_number: int, _frame: FrameType | None) -> None:
        nonlocal step_at
        step_at = min(step_at, true_clock())

    signal.signal(signal.SIGUSR2, step_now)
    time.monotonic_ns = shifted
    # Imported only now: many modules keep a reference to the clock from when they are loaded.
    from common.runtime.live import clock_sync

    identity = secrets.token_bytes(16)
    clock_sync.clock_identity = lambda: identity


def main(argv: Sequence[str] | None = None) -> None:
    """Shift the clock and run the module in this process."""
    parser = argparse.ArgumentParser(
        prog=f"python -m {MODULE}",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--skew", type=float, default=0.0, help="ahead from the start [s]")
    parser.add_argument("--step", type=float, default=0.0, help="set forward later [s]")
    parser.add_argument("--after", type=float, default=5.0, help="time of the step, or SIGUSR2 [s]")
    parser.add_argument("--namespace", action="store_true", help="use a Linux time namespace")
    parser.add_argument("module", help="module to run, with its arguments, after --")
    arguments, rest = parser.parse_known_args(argv)
    rest = [text for text in rest if text != "--"]
    if arguments.namespace:
        enter_time_namespace(arguments.skew)
        # Linux enters the namespace in exec since 6.3; before, only the next child does.
        os.execv(sys.executable, [sys.executable, "-m", arguments.module, *rest])
    shift_clock(arguments.skew, arguments.step, arguments.after)
    sys.argv = [arguments.module, *rest]
    runpy.run_module(arguments.module, run_name="__main__", alter_sys=True)


if __name__ == "__main__":
    main()
