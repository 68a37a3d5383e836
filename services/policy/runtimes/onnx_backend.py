"""Computes an exported network with ONNX Runtime; without torch."""

from typing import Any

import numpy as np
import onnxruntime
from numpy.typing import NDArray

from services.policy.checkpoint.exported import Exported
from services.policy.errors import PolicyError
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision
from services.policy.runtimes.runtime import Features, Memory

_PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider"}


class OnnxBackend:
    """Computes an exported network; see :class:`services.policy.runtimes.runtime.Backend`."""

    def __init__(self, exported: Exported, device: str = "cpu", threads: int = 1) -> None:
        """Prepare both parts.

        Raises:
            PolicyError: the device is not there.
        """
        provider = _PROVIDERS.get(device, "")
        if provider not in onnxruntime.get_available_providers():
            raise PolicyError(
                f"ONNX Runtime cannot run a policy on device {device!r}: expected cpu, or cuda "
                "with the package onnxruntime-gpu in place of onnxruntime"
            )
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = threads
        options.inter_op_num_threads = 1
        self._step = _session(exported.step, options, provider)
        self._look = _session(exported.look, options, provider) if exported.look else None

    def look(self, pictures: Picture) -> Features:
        """Return what the network sees in pictures of k frames, (k, m)."""
        if self._look is None:
            return np.zeros((len(pictures), 0), dtype=np.float32)
        # Frame by frame: all calls are alike, and on a processor a batch saves nothing.
        return np.stack([self._look.run(None, {"pictures": frame})[0] for frame in pictures])

    def step(
        self, observations: NDArray[np.float32], seen: Features, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for the last of t frames and the memory after it."""
        feed = {"observation": observations, "seen": seen, "memory": memory}
        hands, grasp, gait, after = self._step.run(None, feed)
        return Decision(hands, grasp, gait), after


def _session(model: bytes, options: Any, provider: str) -> Any:
    return onnxruntime.InferenceSession(model, options, providers=[provider])
