"""Cost of one answer of a policy, by size of the network and by runtime, and of its pictures.

The networks have random weights, which cost as much as trained ones. They take turns, so that noise
of the machine hits all alike. CPU time is robust on a busy machine, wall time is what the robot
waits for; the ratio is that of the medians of CPU time to torch's in the same run. A policy has
50 ms for a step. One row is one answer: a policy of chunks gives one in five steps, and sees 20
frames for it, of which 5 are new. Runtimes that are not installed are left out; bf16 is OpenVINO
that looks at pictures in 16 bits, where the processor has instructions for them.

    python benchmarks/bench_policy.py [--answers N] [--threads N] [--only paper]
"""

import argparse
import os
import sys
from collections.abc import Callable
from contextlib import suppress
from importlib.util import find_spec
from time import perf_counter, process_time
from typing import NamedTuple

import cv2
import numpy as np
import torch

from common.schemas import CameraFrame
from services.policy.configuration import ChunkConfig, PolicySettings, Profile
from services.policy.errors import PolicyError
from services.policy.kinds import CONFIGS, network
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.pictures import scale_picture
from services.policy.runtimes.runtime import Backend, CachingRuntime, warm_up
from services.policy.runtimes.torch_backend import TorchBackend
from services.policy.serving.config import WINDOW
from services.policy.serving.observer import decoded

_BLAS_THREADS = "OPENBLAS_NUM_THREADS"
EXECUTED = 5
"""Frames from one answer of a policy of chunks to the next."""
_KINDS: dict[Profile, tuple[str, ...]] = {"cpu": ("trill", "bc-rnn", "bc"), "paper": ("trill",)}
"""Policies of one frame that are measured; of the paper's size all kinds cost the same."""
_HEADER = ("answer", "runtime", "CPU median", "p99", "wall median", "p99", "ratio")
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


def backends_of(policy: PolicyNetwork, threads: int) -> dict[str, Backend]:
    """Return all runtimes of a network that are here, by name."""
    found: dict[str, Backend] = {"torch": TorchBackend(policy)}
    if find_spec("onnx") is None or find_spec("onnxruntime") is None:
        return found
    from services.policy.networks.export import export_network
    from services.policy.runtimes.onnx_backend import OnnxBackend

    exported = export_network(policy)
    found["onnx"] = OnnxBackend(exported, threads=threads)
    if find_spec("openvino") is not None:
        from services.policy.runtimes.openvino_backend import OpenVinoBackend

        found["openvino"] = OpenVinoBackend(exported, threads=threads)
        with suppress(PolicyError):
            found["bf16"] = OpenVinoBackend(exported, threads=threads, precision="bfloat16")
    return found


def answer_of(config: PolicySettings, frames: int, backend: Backend) -> Callable[[], object]:
    """Return what computes one answer of a policy to ``frames`` frames."""
    runtime, new = CachingRuntime(backend), min(frames, EXECUTED)
    warm_up(runtime, config, frames, new)
    rng = np.random.default_rng(0)
    inputs = config.inputs
    width, height = inputs.picture_size
    shape = (frames, len(inputs.cameras), height, width, 3)
    pictures = rng.integers(0, 255, shape, dtype=np.uint8)
    observations = rng.normal(size=(frames, inputs.width)).astype(np.float32)
    memory = np.zeros(config.memory_shape, dtype=np.float32)

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


def rows(only: str, threads: int) -> dict[tuple[str, str], Callable[[], object]]:
    """Return what is measured, by the names of its row and of its runtime."""
    found: dict[tuple[str, str], Callable[[], object]] = {}
    chunks = {"actions": ChunkConfig()}
    asked: dict[str, tuple[PolicySettings, int]] = {}
    for profile, kinds in _KINDS.items():
        asked |= {f"{profile} {k}, 1 frame": (CONFIGS[k].profile(profile), 1) for k in kinds}
        trill = CONFIGS["trill"].profile(profile).model_copy(update=chunks)
        asked[f"{profile} trill, chunk"] = (trill, WINDOW)
    for name, (config, frames) in asked.items():
        if only in name:
            for runtime, backend in backends_of(network(config), threads).items():
                found[name, runtime] = answer_of(config, frames, backend)
    if only in "pictures":
        found["stereo pair to 60x45", ""] = pictures_of((60, 45))
        found["stereo pair, 400x300 kept", ""] = pictures_of(CAMERA)
    return found


def main() -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--answers", type=int, default=200, help="runs of each row (200)")
    parser.add_argument("--threads", type=int, default=1, help="of each runtime (1)")
    parser.add_argument("--only", default="", help="rows whose names have this, as cpu or paper")
    arguments = parser.parse_args()
    if _BLAS_THREADS not in os.environ:
        # As the service does; numpy reads it when it is imported.
        os.environ[_BLAS_THREADS] = "1"
        os.execv(sys.executable, [sys.executable, *sys.argv])
    torch.set_num_threads(arguments.threads)
    torch.manual_seed(0)
    found = rows(arguments.only, arguments.threads)
    costs: dict[tuple[str, str], list[Cost]] = {name: [] for name in found}
    for index in range(arguments.answers):
        print(f"round {index + 1}/{arguments.answers}", end="\r", file=sys.stderr)
        for name, work in found.items():
            costs[name].append(timed(work))
    print(f"torch {torch.__version__}, {arguments.threads} thread(s) each, [ms]")
    print("{:26}{:10}{:>11}{:>8}{:>13}{:>8}{:>7}".format(*_HEADER))
    for key, measured in costs.items():
        cpu, wall = ([1e3 * getattr(cost, kind) for cost in measured] for kind in ("cpu", "wall"))
        figures = (*np.percentile(cpu, (50, 99)), *np.percentile(wall, (50, 99)))
        base = np.median([cost.cpu for cost in costs.get((key[0], "torch"), measured)])
        row = "{:26}{:10}{:11.2f}{:8.2f}{:13.2f}{:8.2f}".format(*key, *figures)
        print(f"{row}{1e-3 * figures[0] / base:7.2f}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
