"""Computes an exported network with OpenVINO; without torch."""

from typing import Any

import numpy as np
import openvino
from numpy.typing import NDArray

from services.policy.checkpoint.exported import Exported
from services.policy.errors import PolicyError
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision
from services.policy.runtimes.runtime import Features, Memory
from services.policy.serving.config import Precision


class OpenVinoBackend:
    """Computes an exported network; see :class:`services.policy.runtimes.runtime.Backend`.

    With 16 bits the pictures alone are looked at in them: that is where the time goes, and errors
    do not add up in the memory.
    """

    def __init__(
        self,
        exported: Exported,
        device: str = "cpu",
        threads: int = 1,
        precision: Precision = "float32",
    ) -> None:
        """Prepare both parts.

        Raises:
            PolicyError: the device is not there, or does not compute in the precision.
        """
        core, device = openvino.Core(), device.upper()
        available = core.available_devices
        if device not in available:
            raise PolicyError(
                f"OpenVINO cannot run a policy on device {device.lower()!r}: expected "
                f"{' or '.join(name.lower() for name in available)}"
            )
        # It would take the wish, and compute twenty times slower.
        if precision == "bfloat16" and "BF16" not in core.get_property(
            device, "OPTIMIZATION_CAPABILITIES"
        ):
            raise PolicyError(
                f"device {device.lower()!r} has no instructions for bfloat16; expected precision "
                "float32"
            )
        options: dict[str, Any] = {"PERFORMANCE_HINT": "LATENCY"}
        if device == "CPU":
            # Bound to a core it would wait for whoever else is there.
            options |= {
                "INFERENCE_NUM_THREADS": threads,
                "NUM_STREAMS": 1,
                "ENABLE_CPU_PINNING": False,
            }

        def compiled(model: bytes, hint: str) -> Any:
            given = options | {"INFERENCE_PRECISION_HINT": hint}
            return core.compile_model(core.read_model(model), device, given)

        self._step = compiled(exported.step, "f32")
        hint = "bf16" if precision == "bfloat16" else "f32"
        self._look = compiled(exported.look, hint) if exported.look else None

    def look(self, pictures: Picture) -> Features:
        """Return what the network sees in pictures of k frames, (k, m)."""
        if self._look is None:
            return np.zeros((len(pictures), 0), dtype=np.float32)
        # Frame by frame: all calls are alike, and on a processor a batch saves nothing.
        return np.stack([self._look({"pictures": frame})[0] for frame in pictures])

    def step(
        self, observations: NDArray[np.float32], seen: Features, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for the last of t frames and the memory after it."""
        feed = {"observation": observations, "seen": seen, "memory": memory}
        hands, grasp, gait, after = self._step(feed).values()
        return Decision(hands, grasp, gait), after
