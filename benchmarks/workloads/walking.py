"""Print how fast simulated time passes while the robot walks: plant and controller, no cameras.

    python benchmarks/workloads/walking.py [--seed N]

Result: ``speed``, simulated per CPU time of the process, which all of its threads share.
"""

import argparse
import json
from time import process_time

from common.schemas import Gait
from verification.walking.stack import Scenario, Stack

GAITS = (Gait.FORWARD, Gait.TURN_LEFT)
WARM_UP_S = 0.5
"""Simulated time that is not counted: imports on first use, first solution of the QP [s]."""


def speed(seed: int) -> float:
    """Return simulated per CPU time of a walk of :data:`GAITS`."""
    stack = Stack(Scenario(gaits=GAITS, seed=seed, delay=0.01))
    stack.run_for(WARM_UP_S)
    began, cpu = stack.time, process_time()
    stack.run_script()
    cpu = process_time() - cpu
    if stack.operator.completed != len(GAITS):
        raise RuntimeError(f"expected {len(GAITS)} gaits, got {stack.operator.completed}")
    return (stack.time - began) / cpu


def main() -> int:
    """Walk and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seed", type=int, default=0, help="of everything random (0)")
    print(json.dumps({"speed": speed(parser.parse_args().seed)}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
