"""Runs the workloads of a comparison on two builds, in rounds."""

import json
import os
import signal
import subprocess
import sys
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

from benchmarks.builds import OWN_ROOT, Build
from benchmarks.comparison import Row
from common.errors import ConfigError, TrillError
from lab.progress import ProgressBar

SCRIPTS = OWN_ROOT / "benchmarks" / "workloads"
TURN_S = 0.1
"""Two processes whose CPU time is measured take turns of this length [s]."""
PLACO = "placo"
STATES = "states.npz"
STDOUT, STDERR = "stdout.txt", "stderr.txt"
SOFTWARE_GL = {"LIBGL_ALWAYS_SOFTWARE": "1"}
ONE_THREAD = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS"), "1"
)


@dataclass(frozen=True)
class Workload:
    """A script that prints results as a line of JSON, its last one.

    Attributes:
        script: its file name in :data:`SCRIPTS`.
        arguments: of the script.
        seeded: whether it takes ``--seed``, the number of the round.
        wall: whether wall time counts: its runs follow one another, with all the threads they want.
            Otherwise both builds run with one thread, in turns of :data:`TURN_S`.
    """

    script: str
    arguments: tuple[str, ...] = ()
    seeded: bool = False
    wall: bool = False


WORKLOADS: Mapping[str, Workload] = {
    "walking": Workload("walking.py", seeded=True),
    "pictures": Workload("pictures.py"),
    "tick-daqp": Workload("tick.py", ("daqp", "--states", STATES), seeded=True),
    "tick-osqp": Workload("tick.py", ("osqp",), seeded=True),
    "collect": Workload("collect.py", wall=True),
    "bus": Workload("round_trips.py", wall=True),
    "live": Workload("live.py", wall=True),
}


class WorkloadError(TrillError):
    """A workload failed on a build."""


class Run(NamedTuple):
    """A process to be run: its command line, variables and working directory."""

    command: Sequence[str]
    environment: Mapping[str, str]
    folder: Path


def results_in_turn(runs: Iterable[Run]) -> list[dict[str, float] | WorkloadError]:
    """Run processes in turns of :data:`TURN_S`, one of them at a time, the others stopped.

    Whatever else the machine does thus meets all of them alike.
    """
    started: list[tuple[subprocess.Popen[bytes], Path]] = []
    waiting: deque[subprocess.Popen[bytes]] = deque()
    try:
        for run in runs:
            process = _start(run)
            process.send_signal(signal.SIGSTOP)
            started.append((process, run.folder))
            waiting.append(process)
        while waiting:
            process = waiting[0]
            process.send_signal(signal.SIGCONT)
            try:
                process.wait(TURN_S if len(waiting) > 1 else None)
            except subprocess.TimeoutExpired:
                process.send_signal(signal.SIGSTOP)
                waiting.rotate(-1)
            else:
                waiting.popleft()
    finally:
        for process in waiting:
            process.kill()
            process.wait()
    return [_result(process, folder) for process, folder in started]


def _start(run: Run) -> "subprocess.Popen[bytes]":
    """Start a process that writes what it prints to files in its folder."""
    with (run.folder / STDOUT).open("wb") as stdout, (run.folder / STDERR).open("wb") as stderr:
        return subprocess.Popen(
            run.command, env=dict(run.environment), cwd=run.folder, stdout=stdout, stderr=stderr
        )


def _result(process: "subprocess.Popen[bytes]", folder: Path) -> dict[str, float] | WorkloadError:
    """Read the last line of what a process printed."""
    printed, errors = ((folder / name).read_text(errors="replace") for name in (STDOUT, STDERR))
    if process.returncode:
        return WorkloadError("\n".join((errors or printed).splitlines()[-5:]))
    result: dict[str, float] = json.loads(printed.splitlines()[-1])
    return result


_TREE = """
import common
print(common.__file__)
try:
    from common.native import kernels
except ImportError:  # of a version that has none
    raise SystemExit
print(*(name for name, is_used in kernels().items() if not is_used), sep=", ")
"""
"""Prints where a build's packages are, and which of its kernels are not in use."""


def check_tree(build: Build) -> None:
    """Check that a build's own sources are what runs, with all of its compiled kernels or none.

    Raises:
        ConfigError: they are not.
    """
    done = subprocess.run(
        [sys.executable, "-P", "-c", _TREE],
        env=build.environment,
        capture_output=True,
        text=True,
        check=False,
    )
    file, _, missing = done.stdout.strip().partition("\n")
    if not Path(file).is_relative_to(build.root):
        raise ConfigError(
            f"expected the packages of {build.root} to be imported, got "
            f"{(done.stdout or done.stderr).strip()}"
        )
    if missing and os.environ.get("TRILL_NATIVE") != "0":
        raise ConfigError(
            f"expected the compiled kernels of {build.root}, but {missing} is not built from its "
            "present source: run `python hatch_build.py` there, or set TRILL_NATIVE=0 to compare "
            "without any"
        )


class Comparison:
    """Runs the workloads that some rows need on two builds.

    Attributes:
        old: metrics of each round, by ``workload.metric``.
        new: likewise.
    """

    def __init__(
        self, old: Build, new: Build, rows: Iterable[Row], placo: str | None, folder: Path
    ) -> None:
        """Prepare.

        Args:
            old: the build to compare with.
            new: the build to judge.
            rows: that are wanted.
            placo: interpreter that has placo, or None.
            folder: for what the workloads write.
        """
        self._builds = (old, new)
        self._placo = placo
        self._folders = (folder / "old", folder / "new")
        for place in self._folders:
            place.mkdir()
        needed = {name.partition(".")[0] for row in rows for name in (row.metric, row.per) if name}
        self._workloads = {name: work for name, work in WORKLOADS.items() if name in needed}
        self._with_placo = placo is not None and PLACO in needed
        self.old: list[dict[str, float]] = []
        self.new: list[dict[str, float]] = []

    @property
    def runs(self) -> int:
        """Number of steps in a round."""
        return len(self._workloads) + self._with_placo

    def add_round(self, bar: ProgressBar) -> None:
        """Run every workload once on each build, and placo at the new build's states."""
        number = len(self.old)
        rounds: tuple[dict[str, float], dict[str, float]] = ({}, {})
        self.old.append(rounds[0])
        self.new.append(rounds[1])
        order = (0, 1) if number % 2 == 0 else (1, 0)
        for name, work in self._workloads.items():
            runs = [self._run(work, which, number) for which in order]
            groups = [[run] for run in runs] if work.wall else [runs]
            found = [result for group in groups for result in results_in_turn(group)]
            for which, result in zip(order, found, strict=True):
                _add(rounds[which], name, result, bar, self._builds[which].name)
            bar.advance(f"round {number + 1}: {name}")
        if self._with_placo:
            (result,) = results_in_turn([self._placo_run()])
            for metrics in rounds:
                _add(metrics, PLACO, result, bar, PLACO)
            bar.advance(f"round {number + 1}: {PLACO}")

    def _run(self, work: Workload, which: int, number: int) -> Run:
        build = self._builds[which]
        seed = ("--seed", str(number)) if work.seeded else ()
        # -P: the script's own folder is no place to import from.
        command = [sys.executable, "-P", str(SCRIPTS / work.script), *work.arguments, *seed]
        threads = {} if work.wall else ONE_THREAD
        return Run(command, build.environment | SOFTWARE_GL | threads, self._folders[which])

    def _placo_run(self) -> Run:
        model = self._builds[1].root / "common" / "robot" / "draco3.xml"
        script = SCRIPTS / "placo_tick.py"
        command = [str(self._placo), str(script), str(model), STATES]
        return Run(command, os.environ | ONE_THREAD, self._folders[1])


def _add(
    metrics: dict[str, float],
    workload: str,
    result: dict[str, float] | WorkloadError,
    bar: ProgressBar,
    build: str,
) -> None:
    """Add a run's results to a round's; a failed run adds none and is said."""
    if isinstance(result, WorkloadError):
        bar.say(f"{workload}, {build}, failed: {result}")
    else:
        metrics.update({f"{workload}.{key}": float(value) for key, value in result.items()})
