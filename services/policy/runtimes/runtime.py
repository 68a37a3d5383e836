"""Runs frames through a network, whatever computes it; numpy alone."""

from hashlib import blake2b
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from services.policy.configuration import PolicySettings
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import Decision

Features = NDArray[np.float32]
Memory = NDArray[np.float32]
_KEPT = 64
"""Pictures of which it is remembered what the network sees in them; a window has fewer."""


class Backend(Protocol):
    """Computes the two parts of a network: what it sees in pictures, and what it decides."""

    def look(self, pictures: Picture) -> Features:
        """Return what the network sees in pictures of k frames, (k, m).

        Args:
            pictures: (k, cameras, height, width, 3) of the policy's cameras, in their order.
        """

    def step(
        self, observations: NDArray[np.float32], seen: Features, memory: Memory
    ) -> tuple[Decision, Memory]:
        """Return the decision for the last of t frames and the memory after it.

        Args:
            observations: (t, n) observation vectors, oldest first.
            seen: (t, m) what :meth:`look` returned of their pictures.
            memory: before the first frame, see :class:`CachingRuntime`.
        """


class CachingRuntime:
    """Runs frames through a network, and looks at each picture once.

    The memory comes and goes with each call. What is kept is only what the network sees in the last
    pictures, by their content: a policy that looks back asks about most of them again, and to look
    takes most of the time.
    """

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._seen: dict[bytes, Features] = {}

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
        return self._backend.step(observations, self._look(pictures), memory)

    def _look(self, pictures: Picture) -> Features:
        """Return what the network sees in the pictures of t frames, (t, m) features."""
        keys = [blake2b(frame.tobytes(), digest_size=16).digest() for frame in pictures]
        new = {
            key: frame for key, frame in zip(keys, pictures, strict=True) if key not in self._seen
        }
        if new:
            features = self._backend.look(np.stack(list(new.values())))
            self._seen.update(zip(new, features, strict=True))
        found = np.stack([self._seen[key] for key in keys])
        for key in list(self._seen)[:-_KEPT]:
            del self._seen[key]
        return found


def warm_up(runtime: CachingRuntime, policy: PolicySettings, frames: int, new: int) -> None:
    """Run made frames, so that the first real ones take no longer than others.

    Args:
        runtime: of the policy's network.
        policy: its settings.
        frames: in the longest request.
        new: of them, how many pictures have not been in the request before.
    """
    inputs, (width, height) = policy.inputs, policy.inputs.picture_size
    memory = np.zeros(policy.memory_shape, dtype=np.float32)
    for begin, count in ((0, 1), (1, frames), (1 + new, frames)):
        # Each frame has a colour of its own, so that as many pictures are new as in service.
        colours = np.arange(begin, begin + count).astype(np.uint8)[:, None, None, None, None]
        views = np.broadcast_to(colours, (count, len(inputs.cameras), height, width, 3))
        runtime.run(np.zeros((count, inputs.width), dtype=np.float32), views, memory)
