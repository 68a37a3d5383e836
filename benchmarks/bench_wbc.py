"""Cost of one controller tick, split by stage, for each QP solver; and sim-time speed.

The solvers take turns, two gaits each, in closed loop with the simulated plant, so that noise of
the machine hits all alike and every tick starts with caches as cold as in service. Garbage
collection is off while they walk, as in the live service. Compiled kernels solve the QP whatever
the solver is called: to compare the solvers, set TRILL_NATIVE=0.
Run it with ``make bench`` or ``python benchmarks/bench_wbc.py``.
"""

import argparse
import sys
from time import perf_counter
from typing import get_args

import numpy as np

from benchmarks.workloads.tick import Meter, Solver, walk
from benchmarks.workloads.walking import speed

STAGES = ("model", "tasks", "build", "solve")
SOLVERS: tuple[Solver, ...] = get_args(Solver)


def measure(rounds: int) -> tuple[dict[str, list[Meter]], list[float]]:
    """Walk with each solver in turn.

    Returns:
        meters by solver, and simulated per CPU time of as many walks with the default solver.
    """
    meters: dict[str, list[Meter]] = {solver: [] for solver in SOLVERS}
    speeds: list[float] = []
    for index in range(rounds):
        for solver in SOLVERS:
            meters[solver].append(walk(solver, index, perf_counter))
            print(f"round {index + 1}/{rounds}: {solver}", end="\r", file=sys.stderr)
        speeds.append(speed(index))
    return meters, speeds


def _row(label: str, seconds: list[float]) -> str:
    median, p99, worst = (1e3 * float(np.percentile(seconds, p)) for p in (50, 99, 100))
    return f"{label:22}{median:9.3f}{p99:9.3f}{worst:9.3f}{p99 / median:12.2f}"


def main() -> int:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=3, help="turns of each solver")
    rounds = parser.parse_args().rounds
    meters, speeds = measure(rounds)
    print(f"{'whole-body tick [ms]':22}{'median':>9}{'p99':>9}{'max':>9}{'p99/median':>12}")
    for solver in SOLVERS:
        print(_row(solver, [t for meter in meters[solver] for t in meter.seconds]))
        for stage in STAGES:
            found = [report.stages[stage] for m in meters[solver] for report in m.reports]
            print(_row(f"  {stage}", found))
    print(f"ticks per solver: {sum(len(m.seconds) for m in meters[SOLVERS[0]])}")
    fastest, typical = max(speeds), float(np.median(speeds))
    print(
        f"sim-time without cameras, default solver, one core: {typical:.1f} × real time "
        f"(median of {rounds}; best {fastest:.1f})"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
