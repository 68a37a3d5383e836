"""Windows of demonstrations as batches: drawn by a seed, with noise on what is observed."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.episodes.columns import BY_PATH
from lab.learning.training.config import NoiseConfig, TrainingConfig
from services.policy.networks.policy import TargetBatch
from services.policy.processor.pictures import Picture
from services.policy.processor.processor import ESTIMATED, Processor

Array = NDArray[Any]
_CPU = torch.device("cpu")
_ALL = slice(None)


class Batch(NamedTuple):
    """Windows of t frames, b of them.

    Attributes:
        observation: (b, t, n) observation vectors.
        pictures: (b, t, cameras, height, width, 3) pictures; no cameras if they are not looked at.
        seen: (b, t, m) numbers of the scene in place of an estimate from the pictures, or None.
        targets: of the frames ``at``.
        at: (k,) frames of each window that count.
    """

    observation: Tensor
    pictures: Tensor
    seen: Tensor | None
    targets: TargetBatch
    at: Tensor


class Spread(NamedTuple):
    """Standard deviations (n,) of the noise on a vector, in its normalised units.

    Attributes:
        constant: one draw for a window.
        white: one draw for a frame.
    """

    constant: Array
    white: Array

    def draw(self, rng: np.random.Generator, windows: int, frames: int) -> NDArray[np.float32]:
        """Return noise (windows, frames, n)."""
        constant = rng.standard_normal((windows, 1, len(self.constant))) * self.constant
        white = rng.standard_normal((windows, frames, len(self.white))) * self.white
        return np.asarray(constant + white, dtype=np.float32)


def observation_spread(processor: Processor, noise: NoiseConfig) -> Spread:
    """Return the noise on a policy's observation vectors."""
    constant: list[float] = []
    white: list[float] = []
    for name, width in processor.inputs.parts.items():
        if name == "observation/control_state":
            break
        parts = [(0.0, 0.0)] * width
        if name == "observation/poses":
            parts = [
                (noise.hand, noise.hand_white) if _is_hand_position(label) else (0.0, 0.0)
                for label in BY_PATH[name].names
            ]
        elif name == "previous_setpoint":
            # Positions and rotation vectors of both hands.
            parts = [(noise.setpoint if i % 6 < 3 else 0.0, 0.0) for i in range(width)]
        elif name == "scene":
            scales = [
                noise.scene if label.endswith((".x", ".y", ".z")) else noise.scene_angle
                for label in processor.inputs.scene
            ]
            parts = [(scale, 0.5 * scale) for scale in scales]
        constant += [part[0] for part in parts]
        white += [part[1] for part in parts]
    scale = np.array(processor.observation.scale)
    rest = np.zeros(processor.inputs.width - len(scale))
    return Spread(
        np.concatenate((np.array(constant) / scale, rest)),
        np.concatenate((np.array(white) / scale, rest)),
    )


def _is_hand_position(name: str) -> bool:
    return "_hand." in name and name.endswith((".x", ".y", ".z"))


class Windows:
    """All windows of some demonstrations.

    A window may begin in any frame. Beyond the end of its episode the last frame is repeated, and
    does not count. All of them are on the device, so that nothing but numbers of frames, and noise,
    is copied in a step.
    """

    def __init__(
        self,
        processor: Processor,
        episodes: Sequence[dict[str, Any]],
        pictures: Picture,
        config: TrainingConfig,
        device: torch.device = _CPU,
    ) -> None:
        """Prepare observations and targets.

        Args:
            processor: of the policy.
            episodes: columns of each demonstration.
            pictures: (frames, cameras, height, width, 3) of all of them, in order.
            config: of training.
            device: on which batches are made.
        """
        self._config, self._device = config, device
        self._pictures = self._tensor(pictures)
        observation = np.concatenate([processor.episode(arrays) for arrays in episodes])
        self._observation = self._tensor(observation)
        found = [processor.targets(arrays) for arrays in episodes]
        columns = (np.concatenate(parts) for parts in zip(*found, strict=True))
        self._targets = [self._tensor(column) for column in columns]
        lengths = [len(targets.gait) for targets in found]
        self._last = np.repeat(np.cumsum(lengths) - 1, lengths)
        self._first = np.cumsum([0, *lengths[:-1]])
        helped = np.concatenate([np.asarray(arrays["intervention"]) for arrays in episodes])
        self._kinds = [np.flatnonzero(helped), np.flatnonzero(~helped)]
        """Frames of interventions, and all others."""
        self._scene = None
        if processor.scene is not None:
            shown = np.concatenate([np.asarray(arrays[ESTIMATED]) for arrays in episodes])
            self._scene = self._tensor(processor.scene.normalise(shown))

    def __len__(self) -> int:
        return len(self._last)

    def draw(
        self,
        rng: np.random.Generator,
        count: int,
        observation: Spread,
        scene: Spread | None = None,
        part: slice = _ALL,
    ) -> Batch:
        """Return ``count`` random windows with noise on what is observed, or a part of them."""
        config = self._config
        starts = self._starts(rng, count)
        kept = config.loss_frames or config.window
        at = np.sort(rng.permutation(config.window)[:kept])
        most, shape = config.shift, (count, config.window)
        moves = rng.integers(-most, most + 1, size=(count, 2))[part] if most else None
        batch = self._batch(starts[part], at, moves)
        batch.observation.add_(self._tensor(observation.draw(rng, *shape)[part]))
        if batch.seen is not None and scene is not None:
            batch.seen.add_(self._tensor(scene.draw(rng, *shape)[part]))
        return batch

    def _starts(self, rng: np.random.Generator, count: int) -> Array:
        """Return the first frames of random windows."""
        share = self._config.interventions.share
        if share is None or not all(map(len, self._kinds)):
            return rng.integers(len(self), size=count)
        helped = rng.binomial(count, share)
        parts = zip(self._kinds, (helped, count - helped), strict=True)
        return np.concatenate([rng.choice(frames, size=size) for frames, size in parts])

    def whole(self, count: int) -> list[Batch]:
        """Return the episodes cut into windows without overlap, ``count`` in a batch, no noise."""
        window = self._config.window
        ends = [*self._first[1:].tolist(), len(self)]
        spans = zip(self._first.tolist(), ends, strict=True)
        starts = np.concatenate([np.arange(first, end, window) for first, end in spans])
        at = np.arange(window)
        return [self._batch(starts[i : i + count], at, None) for i in range(0, len(starts), count)]

    def _batch(self, starts: Array, at: Array, moves: Array | None) -> Batch:
        frames = starts[:, None] + np.arange(self._config.window)
        valid = frames <= self._last[starts][:, None]
        index = self._tensor(np.minimum(frames, self._last[starts][:, None]))
        counted = index[:, at]
        counts = self._tensor(valid[:, at])
        targets = TargetBatch._make([*(column[counted] for column in self._targets), counts])
        pictures = self._pictures[index]
        if moves is not None:
            pictures = shifted(pictures, moves)
        seen = None if self._scene is None else self._scene[index]
        return Batch(self._observation[index], pictures, seen, targets, self._tensor(at))

    def _tensor(self, array: Array) -> Tensor:
        return torch.from_numpy(array).to(self._device)


def shifted(pictures: Tensor, moves: Array) -> Tensor:
    """Return windows of pictures (b, t, cameras, h, w, 3), each shifted by (b, 2) pixels.

    All pictures of a window are shifted alike, down and to the right: disparity between the eyes is
    distance, and motion between frames is motion. Edges are repeated.
    """
    height, width = pictures.shape[3:5]
    moved = torch.empty_like(pictures)
    for i, (down, right) in enumerate(moves):
        rows = np.clip(np.arange(height) + down, 0, height - 1)
        columns = np.clip(np.arange(width) + right, 0, width - 1)
        moved[i] = pictures[i][:, :, rows][:, :, :, columns]
    return moved
