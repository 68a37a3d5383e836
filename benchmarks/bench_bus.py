"""Measure the cost of the typed bus: round trips against raw Zenoh and TCP, codec, runner.

python benchmarks/bench_bus.py [--rounds N] [--rate HZ]
"""

import argparse
import gc
import time
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from benchmarks.workloads.round_trips import HEADER, measure_round_trips, plant_state
from common.links.delay import DelayLine
from common.links.spec import LinkSpec
from common.runtime.live.realtime import enter_realtime
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import CameraFrame, JointCommand, Message
from common.topics import CAMERA_LEFT, PLANT_STATE, WBC_COMMAND, Topic
from common.wire.codec import decode, encode


def joint_command() -> JointCommand:
    """Return a command with random numbers."""
    rng = np.random.default_rng(1)
    names = ("position", "velocity", "acceleration", "torque", "stiffness", "damping")
    return JointCommand(
        gripper_closure=np.zeros(2),
        **{name: rng.normal(size=27) for name in names},  # type: ignore[arg-type]
    )


def best_us(function: Callable[[], object], repeats: int = 200, number: int = 100) -> float:
    """Return the shortest time of one call [us], the least disturbed by other work."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter_ns()
        for _ in range(number):
            function()
        best = min(best, (time.perf_counter_ns() - start) / number)
    return best / 1e3


def measure_codec() -> None:
    """Measure and print the time of encoding and of decoding."""
    image = CameraFrame(eye="left", width=640, height=360, encoding="jpeg", data=bytes(30_000))
    messages: Sequence[tuple[Topic[Any], Message]] = (
        (PLANT_STATE, plant_state()),
        (WBC_COMMAND, joint_command()),
        (CAMERA_LEFT, image),
    )
    print("codec, best of 200 runs")
    for topic, message in messages:
        payload = encode(message, HEADER)
        there = best_us(lambda message=message: encode(message, HEADER))  # type: ignore[misc]
        back = best_us(lambda p=payload, s=topic.schema: decode(p, s))  # type: ignore[misc]
        print(
            f"  {type(message).__name__:13s} {len(payload):6d} bytes   encode {there:6.1f} us   "
            f"decode and check {back:6.1f} us"
        )


class Idle(Service):
    """Reads what the plant reads and does nothing, every millisecond."""

    name = "sim"
    period_ns = 1_000_000
    reads = (WBC_COMMAND,)

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Do nothing."""
        return ()


def measure_runner_and_delay() -> None:
    """Print the overhead of simulated time and of the delay line."""
    runner = SimTimeRunner([Idle()])
    per_step = best_us(lambda: runner.run_for(1.0), repeats=10, number=1) / 1000
    line: DelayLine[int] = DelayLine(LinkSpec.parse("lognormal(122ms, 190ms)"))
    clock = iter(range(0, 10**15, 5_000_000))

    def through() -> None:
        now = next(clock)
        line.push(0, now)
        line.pop(now)

    print(
        f"simulated time: {per_step:.2f} us per step when nothing arrives; delay line: "
        f"{best_us(through, repeats=50):.1f} us per message"
    )


def main() -> int:
    """Measure everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=3000, help="round trips of each kind")
    parser.add_argument(
        "--rate",
        type=float,
        default=200.0,
        help="rate of the second run [Hz]",
    )
    parser.add_argument(
        "--rt-priority", type=int, default=20, help="SCHED_FIFO like the services; 0 for none"
    )
    arguments = parser.parse_args()
    scheduling = enter_realtime(arguments.rt_priority)
    gc.disable()  # as the live runner does during steps
    print(f"scheduling: {scheduling}")
    measure_round_trips(arguments.rounds, 0.0)
    measure_round_trips(max(1, arguments.rounds // 10), arguments.rate)
    measure_codec()
    measure_runner_and_delay()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
