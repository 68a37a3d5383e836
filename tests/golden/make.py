"""Make the golden log: ``python -m tests.golden.make [file]``.

Plant and controller in simulated time: the robot stands up, moves its hands and begins a fast step
forward, under 10 ms of loop delay and state noise. The log holds what the controller read and
wrote, and its journal. See README.md for when it is made anew.
"""

import sys
from pathlib import Path

import numpy as np

from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from common.wire.header import wire_header
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from verification.walking.stack import NOISE, Scenario, Stack

GOLDEN = Path(__file__).with_name("wbc.mcap")
SECONDS = 2.3
_KEPT = ("plant/state", "teleop/", "wbc/", "journal/wbc")
_NOWHERE = {"host": "simulated", "clock": "simulated", "monotonic_ns": "0", "wall_ns": "0"}


def hands(time: float) -> tuple[Array, Array]:
    """Positions (3,) of the left and the right hand in the body frame [m]."""
    left = np.array([0.32 + 0.06 * np.sin(3.0 * time), 0.26, 0.04])
    right = np.array([0.32, -0.26, 0.06 + 0.05 * np.sin(2.0 * time)])
    return left, right


def scenario() -> Scenario:
    """What happens in the golden log."""
    return Scenario(
        gaits=(Gait.FORWARD,), pace="fast", delay=0.010, noise=NOISE, hands=hands, seed=7
    )


def write(path: Path, seconds: float = SECONDS) -> int:
    """Run it and write the log; returns the number of messages."""
    stack = Stack(scenario(), record=True)
    stack.runner.run_for(seconds)
    return save(stack, path)


def save(stack: Stack, path: Path) -> int:
    """Write what the controller of a recorded stack read and wrote; returns how many messages."""
    robot, _, _ = stack.runner.log[0].key.partition("/")
    # One chunk: what the journal repeats is then compressed away.
    sink = McapSink(path, robot, LoggerConfig(chunk_size=2**24), _NOWHERE)
    kept = [s for s in stack.runner.log if s.key.startswith(tuple(f"{robot}/{k}" for k in _KEPT))]
    for sample in kept:
        sink.write(sample, wire_header(sample.payload))
    sink.close()
    return len(kept)


def main() -> int:
    """Replace the golden log."""
    path = Path(sys.argv[1]) if len(sys.argv) > 1 else GOLDEN
    path.unlink(missing_ok=True)
    count = write(path)
    print(f"{path}: {count} messages, {path.stat().st_size / 1000:.0f} kB")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
