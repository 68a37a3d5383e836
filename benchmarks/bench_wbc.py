"""Cost of one controller tick, split by stage, for each QP solver; and sim-time speed.

The solvers take turns, one gait each, in closed loop with the simulated plant, so that noise of
the machine hits all alike and every tick starts with caches as cold as in service.
Run it with ``make bench`` or ``python benchmarks/bench_wbc.py``.
"""

import argparse
import sys
from collections import defaultdict
from time import perf_counter, process_time
from typing import Literal

import numpy as np

from common.schemas import Gait, PlantState
from services.wbc.controller import Command, Controller, TickReport
from verification.walking.stack import Scenario, Stack

STAGES = ("model", "tasks", "build", "solve")
SOLVERS: tuple[Literal["osqp", "daqp", "quadprog"], ...] = ("osqp", "daqp", "quadprog")
ROUND = (Gait.FORWARD, Gait.TURN_LEFT)


class Meter:
    """Wraps a controller's tick with a clock."""

    def __init__(self, controller: Controller) -> None:
        self._tick = controller.tick
        self.total: list[float] = []
        self.stages: defaultdict[str, list[float]] = defaultdict(list)

    def tick(self, state: PlantState, time: float) -> tuple[Command, TickReport]:
        """Tick and keep the times."""
        start = perf_counter()
        command, report = self._tick(state, time)
        self.total.append(perf_counter() - start)
        for stage in STAGES:
            self.stages[stage].append(report.stages[stage])
        return command, report


def measure(rounds: int) -> tuple[dict[str, list[Meter]], list[float]]:
    """Walk :data:`ROUND` with each solver in turn.

    Returns:
        meters by solver, and simulated per CPU time of the runs with the default solver.
    """
    meters: dict[str, list[Meter]] = {solver: [] for solver in SOLVERS}
    speeds: list[float] = []
    for index in range(rounds):
        for solver in SOLVERS:
            stack = Stack(Scenario(gaits=ROUND, solver=solver, seed=index, delay=0.01))
            meter = Meter(stack.wbc_service.controller)
            stack.wbc_service.controller.tick = meter.tick  # type: ignore[method-assign]
            meters[solver].append(meter)
            start = process_time()
            stack.run_script()
            if solver == SOLVERS[0]:
                speeds.append(stack.time / (process_time() - start))
            print(f"round {index + 1}/{rounds}: {solver}", end="\r", file=sys.stderr)
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
        total = [t for meter in meters[solver] for t in meter.total]
        print(_row(f"{solver}", total))
        for stage in STAGES:
            print(_row(f"  {stage}", [t for m in meters[solver] for t in m.stages[stage]]))
    print(f"ticks per solver: {sum(len(m.total) for m in meters[SOLVERS[0]])}")
    fastest, typical = max(speeds), float(np.median(speeds))
    print(
        f"sim-time without cameras, osqp, one core: {typical:.1f} × real time "
        f"(median of {rounds}; best {fastest:.1f})"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
