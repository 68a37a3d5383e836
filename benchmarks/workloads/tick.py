"""Print the time of one controller tick, in closed loop with the simulated plant, walking.

    python benchmarks/workloads/tick.py osqp|daqp|quadprog [--seed N] [--states FILE.npz]

Time is CPU time of the ticking thread, garbage collection off as in the live service. Results:
``median_ms`` and ``p99_ms``. ``--states`` writes the state of every tick.
"""

import argparse
import gc
import json
from collections.abc import Callable
from pathlib import Path
from time import thread_time
from typing import Literal, get_args

import numpy as np

from common.schemas import Gait, PlantState
from services.wbc.controller import Command, Controller, TickReport
from verification.walking.stack import Scenario, Stack

Solver = Literal["osqp", "daqp", "quadprog"]
GAITS = (Gait.FORWARD, Gait.TURN_LEFT)
WARM_UP = 20
"""Ticks that are not counted."""
FIELDS = (
    "base_position",
    "base_quaternion",
    "base_linear_velocity",
    "base_angular_velocity",
    "joint_position",
    "joint_velocity",
    "foot_normal_force",
)
"""What a controller needs to know of a state."""


class Meter:
    """Takes the place of a controller's tick and times it.

    Attributes:
        seconds: time of each tick by the clock [s].
        reports: of each tick.
        states: of each tick.
    """

    def __init__(self, controller: Controller, clock: Callable[[], float]) -> None:
        self._tick, self._clock = controller.tick, clock
        self.seconds: list[float] = []
        self.reports: list[TickReport] = []
        self.states: list[PlantState] = []
        controller.tick = self.tick  # type: ignore[method-assign]

    def tick(self, state: PlantState, time: float) -> tuple[Command, TickReport]:
        """Tick."""
        began = self._clock()
        command, report = self._tick(state, time)
        self.seconds.append(self._clock() - began)
        self.reports.append(report)
        self.states.append(state)
        return command, report


def walk(solver: Solver, seed: int, clock: Callable[[], float] = thread_time) -> Meter:
    """Walk :data:`GAITS` with garbage collection off."""
    stack = Stack(Scenario(gaits=GAITS, solver=solver, seed=seed, delay=0.01))
    meter = Meter(stack.wbc_service.controller, clock)
    gc.collect()
    gc.disable()
    try:
        stack.run_script()
    finally:
        gc.enable()
    if stack.operator.completed != len(GAITS):
        raise RuntimeError(f"expected {len(GAITS)} gaits, got {stack.operator.completed}")
    return meter


def main() -> int:
    """Walk and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("solver", choices=get_args(Solver))
    parser.add_argument("--seed", type=int, default=0, help="of everything random (0)")
    parser.add_argument("--states", type=Path, metavar="FILE.npz", help="where to write the states")
    arguments = parser.parse_args()
    meter = walk(arguments.solver, arguments.seed)
    if arguments.states:
        table = {name: np.array([getattr(s, name) for s in meter.states]) for name in FIELDS}
        np.savez(arguments.states, **table)  # type: ignore[arg-type]
    median, p99 = 1e3 * np.percentile(meter.seconds[WARM_UP:], (50.0, 99.0))
    print(json.dumps({"median_ms": median, "p99_ms": p99}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
