"""Cost of one step of a policy: pictures, observation, inference, by size of the network.

The networks have random weights, which cost as much as trained ones. They take turns, so that noise
of the machine hits all alike. CPU time is robust on a busy machine, wall time is what the robot
waits for. A policy has 50 ms for a step. One row is one answer: a policy of chunks gives one in
five steps, and sees 20 frames for it.

    python benchmarks/bench_policy.py [--answers N] [--threads N] [--device cuda]
"""

import argparse
import os
import sys
from collections.abc import Callable
from time import perf_counter, process_time
from typing import NamedTuple

import cv2
import numpy as np
import torch

from common.schemas import CameraFrame
from services.policy.configuration import ChunkConfig, DifferenceConfig, PolicySettings
from services.policy.kinds import CONFIGS, network
from services.policy.networks.runtime import TorchRuntime
from services.policy.processor.pictures import scale_picture
from services.policy.serving.config import WINDOW
from services.policy.serving.observer import decoded

_BLAS_THREADS = "OPENBLAS_NUM_THREADS"
EXECUTED = 5
"""Frames from one answer of a policy of chunks to the next."""
CAMERA = (400, 300)
"""Width and height of the cameras' pictures [pixels]."""


class Cost(NamedTuple):
    """Times of one run [s]."""

    wall: float
    cpu: float


def timed(work: Callable[[], object]) -> Cost:
    """Run ``work`` once."""
    wall, cpu = perf_counter(), process_time()
    work()
    return Cost(perf_counter() - wall, process_time() - cpu)


def answer_of(config: PolicySettings, frames: int, device: str) -> Callable[[], object]:
    """Return what computes one answer of a policy to ``frames`` frames."""
    runtime = TorchRuntime(network(config), device)
    runtime.warm_up(frames)
    rng = np.random.default_rng(0)
    inputs = config.inputs
    width, height = inputs.picture_size
    shape = (frames, len(inputs.cameras), height, width, 3)
    pictures = rng.integers(0, 255, shape, dtype=np.uint8)
    observations = rng.normal(size=(frames, inputs.width)).astype(np.float32)
    memory = np.zeros(config.memory_shape, dtype=np.float32)
    new = min(frames, EXECUTED)

    def answer() -> object:
        # The robot has seen so many pictures since the last answer.
        pictures[:] = np.roll(pictures, -new, axis=0)
        pictures[-new:] += 1
        return runtime.run(observations, pictures, memory)

    return answer


def pictures_of(size: tuple[int, int]) -> Callable[[], object]:
    """Return what decodes a stereo pair of JPEG files and scales it to ``size``."""
    noise = np.random.default_rng(0).integers(0, 255, (30, 40, 3), dtype=np.uint8)
    file = cv2.imencode(".jpg", cv2.resize(noise, CAMERA), [cv2.IMWRITE_JPEG_QUALITY, 90])[1]
    width, height = CAMERA
    frame = CameraFrame(
        eye="left", width=width, height=height, encoding="jpeg", data=file.tobytes()
    )
    return lambda: [scale_picture(decoded(frame), size) for _ in range(2)]


def rows(device: str) -> dict[str, Callable[[], object]]:
    """Return what is measured, by the name of its row."""
    found: dict[str, Callable[[], object]] = {}
    for profile in ("cpu", "paper"):
        for kind in ("trill", "bc-rnn", "bc"):
            config = (
                CONFIGS[kind].profile(profile).model_copy(update={"actions": DifferenceConfig()})
            )
            found[f"{profile} {kind}, 1 frame"] = answer_of(config, 1, device)
    chunks = CONFIGS["trill"].profile("cpu").model_copy(update={"actions": ChunkConfig()})
    found[f"cpu trill, chunk, {WINDOW} frames"] = answer_of(chunks, WINDOW, device)
    found["stereo pair to 60x45"] = pictures_of((60, 45))
    found["stereo pair, 400x300 kept"] = pictures_of(CAMERA)
    return found


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--answers", type=int, default=200, help="runs of each row (200)")
    parser.add_argument("--threads", type=int, default=1, help="of torch (1)")
    parser.add_argument("--device", default="cpu", help="of torch (cpu)")
    arguments = parser.parse_args()
    if _BLAS_THREADS not in os.environ:
        # As the service does; numpy reads it when it is imported.
        os.environ[_BLAS_THREADS] = "1"
        os.execv(sys.executable, [sys.executable, *sys.argv])
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(0)
    found = rows(arguments.device)
    costs: dict[str, list[Cost]] = {name: [] for name in found}
    for index in range(arguments.answers):
        print(f"round {index + 1}/{arguments.answers}", end="\r", file=sys.stderr)
        for name, work in found.items():
            costs[name].append(timed(work))
    print(f"torch {torch.__version__}, {arguments.device}, {arguments.threads} thread(s), [ms]")
    print(f"{'answer':28}{'CPU median':>12}{'CPU p99':>10}{'wall median':>13}{'wall p99':>10}")
    for name, measured in costs.items():
        cpu, wall = ([1e3 * getattr(cost, kind) for cost in measured] for kind in ("cpu", "wall"))
        figures = (*np.percentile(cpu, (50, 99)), *np.percentile(wall, (50, 99)))
        print("{:28}{:12.2f}{:10.2f}{:13.2f}{:10.2f}".format(name, *figures))
    return 0


if __name__ == "__main__":
    sys.exit(main())
