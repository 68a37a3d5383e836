"""Computes a network with torch."""

from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from services.policy.checkpoint.folder import load_checkpoint
from services.policy.errors import PolicyError
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision
from services.policy.runtimes.runtime import Features, Memory


class TorchBackend:
    """Computes a network with torch; see :class:`services.policy.runtimes.runtime.Backend`.

    How many threads torch takes is the process's to say; beside a simulator it should be one.
    """

    def __init__(self, network: PolicyNetwork, device: str = "cpu") -> None:
        self._network = network.to(device).eval()
        self._device = device
        self._last = torch.tensor([-1], device=device)

    def look(self, pictures: Picture) -> Features:
        """Return what the network sees in pictures of k frames, (k, m)."""
        with torch.inference_mode():
            return self._array(self._network.look(self._tensor(pictures)[None])[0])

    def step(
        self, observations: NDArray[np.float32], seen: Features, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for the last of t frames and the memory after it."""
        with torch.inference_mode():
            outputs, after = self._network(
                self._tensor(observations)[None],
                self._tensor(seen)[None],
                self._tensor(memory)[:, :, None],
                self._last,
            )
            parts = self._network.decide(outputs)
            decision = Decision._make(self._array(part[0, 0]) for part in parts)
            return decision, self._array(after[:, :, 0])

    def _tensor(self, array: NDArray[np.float32] | Picture) -> torch.Tensor:
        return torch.from_numpy(array).to(self._device)

    @staticmethod
    def _array(tensor: torch.Tensor) -> NDArray[np.float32]:
        array: NDArray[np.float32] = tensor.float().cpu().numpy()
        return array


def torch_backend(checkpoint: Path, device: str, threads: int) -> TorchBackend:
    """Return a backend of a checkpoint's network.

    Args:
        checkpoint: its folder.
        device: of torch.
        threads: that torch may take in this process.

    Raises:
        CheckpointError: it cannot be served; see
            :func:`~services.policy.checkpoint.folder.load_checkpoint`.
        PolicyError: the device is not there.
    """
    torch.set_num_threads(threads)
    network, _ = load_checkpoint(checkpoint)
    try:
        return TorchBackend(network, device)
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise PolicyError(
            f"cannot run a policy on device {device!r}: {reason}; expected cpu, or cuda with a "
            "build of torch for it"
        ) from error
