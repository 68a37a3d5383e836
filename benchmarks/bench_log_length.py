"""How the cost of reading a log grows with its length: processor time and peak memory.

A minute of a walking robot is repeated to logs of several lengths (:mod:`benchmarks.long_log`),
as one run of each service. Before the repair a log is cut off, in the middle of a chunk. For the
check of a replay, which compares to the byte, logs are simulated from beginning to end instead.
Each command reads each log in a process of its own. A cost grows as it should if the time a minute
of log takes stays the same, and the memory too.

    python benchmarks/bench_log_length.py [--minutes 6 12 24] [--hours 1 2 4 8] [--against DIR]
"""

import argparse
import os
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from benchmarks.builds import OWN_ROOT, Build, own_and
from lab.progress import ProgressBar

COMMANDS = (("info",), ("ledger",), ("report",), ("replay", "--list"))
REPAIR = ("repair", "--out", "repaired.mcap")
CHECK = ("replay", "--check")
"""Takes longer than all others: its logs have lengths of their own."""
_CUT_OFF = 1_000_000
"""At the end of a log that is to be repaired [bytes]."""


@dataclass(frozen=True)
class Use:
    """What a command used: processor time [s] and peak memory [MB]."""

    cpu: float
    memory: float


def use_of(build: Build, command: tuple[str, ...], log: Path) -> Use:
    """Run a command of ``trill`` on a log.

    Raises:
        CalledProcessError: it fails.
    """
    words = build.command(command[0], str(log), *command[1:])
    # In the log's directory, because Python imports what lies in the present one first.
    process = subprocess.Popen(
        words,
        env=build.environment,
        cwd=log.parent,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    _, status, used = os.wait4(process.pid, 0)
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, words)
    return Use(used.ru_utime + used.ru_stime, 1024e-6 * used.ru_maxrss)


def write_log(path: Path, minutes: int, *, anew: bool) -> None:
    """Write a log in a process of its own: a large one would count as its children's memory.

    Raises:
        CalledProcessError: it fails.
    """
    words = [str(path), "--minutes", str(minutes), *["--anew"] * anew]
    subprocess.run(
        [sys.executable, "-m", "benchmarks.long_log", *words],
        cwd=OWN_ROOT,
        env=Build("ours", OWN_ROOT).environment,
        stdout=subprocess.DEVNULL,
        check=True,
    )


def measure(
    commands: tuple[tuple[str, ...], ...],
    minutes: list[int],
    builds: list[Build],
    folder: Path,
    *,
    anew: bool = False,
) -> None:
    """Measure on logs of so many ``minutes``, the builds in turn, and print each result."""
    shortest: dict[tuple[str, str], tuple[int, Use]] = {}
    with ProgressBar("log length", len(minutes) * len(commands) * len(builds)) as bar:
        for length in minutes:
            log = folder / f"{length}{'-anew' * anew}.mcap"
            write_log(log, length, anew=anew)
            for command in commands:
                if command == REPAIR:
                    os.truncate(log, log.stat().st_size - _CUT_OFF)
                for build in builds:
                    (folder / "repaired.mcap").unlink(missing_ok=True)
                    used = use_of(build, command, log)
                    name = " ".join(command)
                    begin, least = shortest.setdefault((name, build.name), (length, used))
                    print(_line(name, build, length, used, begin, least), flush=True)
                    bar.advance()
            log.unlink()


def _line(name: str, build: Build, length: int, used: Use, begin: int, least: Use) -> str:
    return (
        f"{name:<15} {build.name:<8} {length:>5} min {used.cpu:>9.1f} s {used.memory:>6.0f} MB"
        f"   x {length / begin:<5.3g} long: x {used.cpu / least.cpu:<5.3g} time, "
        f"x {used.memory / least.memory:.2f} memory"
    )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(
        description=(__doc__ or "").partition("\n\n")[0],
        epilog="An hour of log takes two gigabytes while it is measured. Logs and what the "
        "commands write go to the directory for temporary files (TMPDIR).",
    )
    lengths = parser.add_mutually_exclusive_group()
    lengths.add_argument(
        "--minutes", type=int, nargs="+", default=[6, 12, 24], help="lengths (6 12 24)"
    )
    lengths.add_argument("--hours", type=int, nargs="+", default=[], help="the same in hours")
    parser.add_argument(
        "--check-minutes",
        type=int,
        nargs="*",
        default=[1, 2],
        help="lengths for replay --check, which takes about as long as the log (1 2); none: skip",
    )
    parser.add_argument("--against", type=Path, metavar="DIR", help="source tree to compare with")
    arguments = parser.parse_args()
    minutes = [60 * hours for hours in arguments.hours] or arguments.minutes
    builds = own_and(arguments.against)
    with tempfile.TemporaryDirectory() as name:
        measure((*COMMANDS, REPAIR), minutes, builds, Path(name))
        measure((CHECK,), arguments.check_minutes, builds, Path(name), anew=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
