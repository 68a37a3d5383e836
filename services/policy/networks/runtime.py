"""Run a network in service: arrays in, arrays out."""

from hashlib import blake2b
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

from services.policy.checkpoint.folder import load_checkpoint
from services.policy.checkpoint.manifest import Description
from services.policy.errors import PolicyError
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision

Memory = NDArray[np.float32]
_KEPT = 64
"""Pictures of which it is remembered what the network sees in them; a window has fewer."""


class TorchRuntime:
    """Runs frames through a network with torch.

    The memory comes and goes with each call. What is kept is only what the network sees in the last
    pictures, by their content: a policy that looks back asks about most of them again, and to look
    takes most of the time. How many threads torch takes is the process's to say; beside a simulator
    it should be one.
    """

    def __init__(self, network: PolicyNetwork, device: str = "cpu") -> None:
        self._network = network.to(device).eval()
        self._device = device
        self._seen: dict[bytes, torch.Tensor] = {}

    def run(
        self, observations: NDArray[np.float32], pictures: Picture, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for the last of t frames and the memory after it.

        Args:
            observations: (t, n) observation vectors, oldest first.
            pictures: (t, cameras, height, width, 3) of the policy's cameras, in their order.
            memory: array of :attr:`~services.policy.configuration.PolicySettings.memory_shape`
                before the first frame; zero at the start.
        """
        last = torch.tensor([len(observations) - 1], device=self._device)
        with torch.inference_mode():
            outputs, after = self._network(
                self._tensor(observations)[None],
                self._tensor(pictures)[None],
                self._tensor(memory)[:, :, None],
                last,
                self._look(pictures)[None],
            )
            parts = self._network.decide(outputs)
            hands, grasp, gait = (part[0, 0].float().cpu().numpy() for part in parts)
            return Decision(hands, grasp, gait), after[:, :, 0].cpu().numpy()

    def _look(self, pictures: Picture) -> torch.Tensor:
        """Return what the network sees in the pictures of t frames, (t, m) features."""
        keys = [blake2b(frame.tobytes(), digest_size=16).digest() for frame in pictures]
        new = {
            key: frame for key, frame in zip(keys, pictures, strict=True) if key not in self._seen
        }
        if new:
            features = self._network.look(self._tensor(np.stack(list(new.values())))[None])[0]
            self._seen.update(zip(new, features, strict=True))
        found = torch.stack([self._seen[key] for key in keys])
        for key in list(self._seen)[:-_KEPT]:
            del self._seen[key]
        return found

    def warm_up(self, frames: int) -> None:
        """Run ``frames`` empty frames, so that the first real ones take no longer than others."""
        inputs = self._network.config.inputs
        width, height = inputs.picture_size
        views = np.zeros((frames, len(inputs.cameras), height, width, 3), dtype=np.uint8)
        memory = np.zeros(self._network.config.memory_shape, dtype=np.float32)
        for count in {1, frames}:
            self.run(np.zeros((count, inputs.width), dtype=np.float32), views[:count], memory)

    def _tensor(self, array: NDArray[np.float32] | Picture) -> torch.Tensor:
        return torch.from_numpy(array).to(self._device)


def load_runtime(
    checkpoint: Path, kind: str | None = None, device: str = "cpu", threads: int = 1
) -> tuple[TorchRuntime, Description]:
    """Return a runtime of a checkpoint's network, and what else the checkpoint holds.

    Args:
        checkpoint: its folder.
        kind: of the policy that is wanted; None: any.
        device: of torch.
        threads: that torch may take in this process.

    Raises:
        CheckpointError: it cannot be served; see
            :func:`~services.policy.checkpoint.folder.load_checkpoint`.
        PolicyError: the device is not there.
    """
    torch.set_num_threads(threads)
    network, description = load_checkpoint(checkpoint, kind)
    try:
        return TorchRuntime(network, device), description
    except (RuntimeError, AssertionError) as error:
        reason = str(error).partition("\n")[0]
        raise PolicyError(
            f"cannot run a policy on device {device!r}: {reason}; expected cpu, or cuda with a "
            "build of torch for it"
        ) from error
