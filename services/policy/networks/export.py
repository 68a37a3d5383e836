"""Exports a network to ONNX; this needs torch, onnx and, to check the result, ONNX Runtime."""

import io
import warnings
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
import torch
from torch import Tensor, nn

from services.policy.checkpoint.exported import Exported, write_exported
from services.policy.checkpoint.folder import load_checkpoint
from services.policy.errors import PolicyError
from services.policy.networks.policy import DecisionBatch, PolicyNetwork
from services.policy.runtimes.onnx_backend import OnnxBackend
from services.policy.runtimes.torch_backend import TorchBackend

TOLERANCE = 1e-4
"""Largest difference between torch and the exported network, normalised actions and features."""
_PACKAGES = ("torch", "onnx", "onnxruntime")


class _Look(nn.Module):
    """Pictures (cameras, height, width, 3) of one frame to what is seen in them (m,)."""

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self._network = network

    def forward(self, pictures: Tensor) -> Tensor:
        return self._network.look(pictures[None, None])[0, 0]


class _Step(nn.Module):
    """Frames of one sequence to the decision for the last one, and the memory after it."""

    def __init__(self, network: PolicyNetwork) -> None:
        super().__init__()
        self._network = network

    def forward(self, observation: Tensor, seen: Tensor, memory: Tensor) -> tuple[Tensor, ...]:
        outputs, after = self._network(
            observation[None], seen[None], memory[:, :, None], torch.tensor([-1])
        )
        decision: DecisionBatch = self._network.decide(outputs)
        return *(part[0, 0] for part in decision), after[:, :, 0]


def export_network(network: PolicyNetwork) -> Exported:
    """Return a network, which is put into its state of service, as ONNX models."""
    inputs = network.eval().config.inputs
    (width, height), cameras = inputs.picture_size, len(inputs.cameras)
    pictures = torch.zeros(cameras, height, width, 3, dtype=torch.uint8)
    look = _exported(_Look(network), (pictures,), ["pictures"], ["seen"], {}) if cameras else b""
    with torch.no_grad():
        seen = network.look(pictures[None, None])[0]
    frames = torch.zeros(2, inputs.width), seen.repeat(2, 1), network.zero_memory(1)[:, :, 0]
    step = _exported(
        _Step(network),
        frames,
        ["observation", "seen", "memory"],
        ["hands", "grasp", "gait", "after"],
        {"observation": {0: "frames"}, "seen": {0: "frames"}},
    )
    return Exported(look, step)


def _exported(
    module: nn.Module,
    given: tuple[Tensor, ...],
    inputs: list[str],
    outputs: list[str],
    axes: dict[str, Any],
) -> bytes:
    file = io.BytesIO()
    with warnings.catch_warnings():
        # The newer exporter of torch 2.13 fixes an LSTM to the number of frames that it is shown.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            # The exporter puts a module, with all in it, back into the state that it was in itself.
            module.eval(),
            given,
            file,
            input_names=inputs,
            output_names=outputs,
            dynamic_axes=axes,
            dynamo=False,
        )
    return file.getvalue()


def export_checkpoint(checkpoint: Path) -> tuple[Path, float]:
    """Export the network of a checkpoint into its folder, after a comparison with torch.

    Returns:
        the folder of the exported network, and the largest difference that was found.

    Raises:
        CheckpointError: the checkpoint cannot be served, or its folder not be written.
        PolicyError: the exported network differs from torch's.
    """
    network, description = load_checkpoint(checkpoint)
    exported = export_network(network)
    difference = largest_difference(network, exported)
    if not difference <= TOLERANCE:
        raise PolicyError(
            f"the exported network of {checkpoint} differs from torch's by {difference:g}: "
            f"expected at most {TOLERANCE:g}; use the runtime torch, or other versions of "
            f"{', '.join(_PACKAGES)}"
        )
    versions = {package: version(package) for package in _PACKAGES}
    return write_exported(checkpoint, description, exported, versions), difference


def largest_difference(network: PolicyNetwork, exported: Exported) -> float:
    """Return by how much ONNX Runtime and torch differ on random frames, over all outputs."""
    config, rng = network.config, np.random.default_rng(0)
    width, height = config.inputs.picture_size
    backends = TorchBackend(network), OnnxBackend(exported)
    worst = 0.0
    for frames in (1, 3, 20):
        shape = (frames, len(config.inputs.cameras), height, width, 3)
        pictures = rng.integers(0, 256, shape, dtype=np.uint8)
        observations = rng.normal(size=(frames, config.inputs.width)).astype(np.float32)
        memory = rng.uniform(-0.5, 0.5, config.memory_shape).astype(np.float32)
        found = [_outputs(backend, observations, pictures, memory) for backend in backends]
        for one, other in zip(*found, strict=True):
            worst = max(worst, float(np.abs(one - other).max(initial=0.0)))
    return worst


def _outputs(backend: Any, observations: Any, pictures: Any, memory: Any) -> list[Any]:
    seen = backend.look(pictures)
    decision, after = backend.step(observations, seen, memory)
    return [seen, *decision, after]
