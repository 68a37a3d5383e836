"""Windows of demonstrations as batches: drawn by a seed, with noise on what is observed."""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from common.episodes.columns import BY_PATH
from common.schemas import ControlState
from lab.learning.training.config import NoiseConfig, TrainingConfig
from lab.learning.training.errors import EstimationErrors
from services.policy.networks.policy import TargetBatch
from services.policy.processor.actions import moving
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

    @classmethod
    def joined(cls, *parts: "Spread") -> "Spread":
        """Return the noise on a vector that is made of several."""
        return cls(*(np.concatenate(column) for column in zip(*parts, strict=True)))


def observation_spread(processor: Processor, noise: NoiseConfig) -> Spread:
    """Return the noise on a policy's observation vectors."""
    constant: list[float] = []
    white: list[float] = []
    for name, width in processor.inputs.parts.items():
        if name == "observation/control_state":
            break
        parts = [(0.0, 0.0)] * width
        if name == "observation/poses":
            parts = [_pose_noise(label, noise) for label in BY_PATH[name].names]
        elif name == "previous_setpoint":
            # Positions and rotation vectors of both hands.
            parts = [(noise.setpoint if i % 6 < 3 else noise.turn, 0.0) for i in range(width)]
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


def _pose_noise(name: str, noise: NoiseConfig) -> tuple[float, float]:
    """Return constant and white noise on the number ``name`` of the column of poses."""
    position = name.endswith((".x", ".y", ".z"))
    if "_foot." in name:
        return (noise.foot if position else 0.0, 0.0)
    # The parts of a quaternion change by half an angle.
    return (noise.hand, noise.hand_white) if position else (0.5 * noise.turn, 0.0)


def _acting(arrays: dict[str, Any]) -> NDArray[np.bool_]:
    """Return in which frames hands or grippers move while the robot stands."""
    moves = moving(np.asarray(arrays["action/hands"]), np.asarray(arrays["action/grasp"]))
    return moves & (np.asarray(arrays["observation/control_state"]) <= ControlState.BALANCE)


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
        errors: EstimationErrors | None = None,
        device: torch.device = _CPU,
    ) -> None:
        """Prepare observations and targets.

        Args:
            processor: of the policy.
            episodes: columns of each demonstration.
            pictures: (frames, cameras, height, width, 3) of all of them, in order.
            config: of training.
            errors: of the estimates that the true numbers of the scene stand for.
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
        self._begin = np.repeat(self._first, lengths)
        self._active = np.flatnonzero(np.concatenate([_acting(arrays) for arrays in episodes]))
        helped = np.concatenate([np.asarray(arrays["intervention"]) for arrays in episodes])
        self._kinds = [np.flatnonzero(helped), np.flatnonzero(~helped)]
        """Frames of interventions, and all others."""
        self._scene = self._relative = None
        if processor.scene is not None:
            shown = np.concatenate([np.asarray(arrays[ESTIMATED]) for arrays in episodes])
            scene = processor.scene.normalise(shown)
            self._scene = self._tensor(scene)
            if errors is not None:
                self._relative = errors.near(scene) / errors.overall

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
        frames = self._starts(rng, count)[:, None] + self._steps(rng, count)
        kept = config.loss_frames or config.window
        at = np.sort(rng.permutation(config.window)[:kept])
        most, shape = config.shift, (count, config.window)
        moves = rng.integers(-most, most + 1, size=(count, 2))[part] if most else None
        batch = self._batch(frames[part], at, moves)
        batch.observation.add_(self._tensor(observation.draw(rng, *shape)[part]))
        if batch.seen is not None and scene is not None:
            noise = scene.draw(rng, *shape)
            if self._relative is not None:
                noise *= self._relative[self._within(frames)]
            batch.seen.add_(self._tensor(noise[part]))
        return batch

    def in_balance(self) -> tuple[NDArray[np.float32], NDArray[np.int64]]:
        """Return the frames whose gait is learned from, without noise, and the gait of each.

        A frame (n,) is the observation vector and the true numbers of the scene that are estimated.
        """
        _, _, gait, counts = self._targets
        parts = [self._observation, *([] if self._scene is None else [self._scene])]
        frames = torch.cat([part[counts] for part in parts], dim=1)
        return frames.cpu().numpy(), gait[counts].cpu().numpy()

    def whole(self, count: int) -> list[Batch]:
        """Return the episodes cut into windows without overlap, ``count`` in a batch, no noise."""
        window = self._config.window
        ends = [*self._first[1:].tolist(), len(self)]
        spans = zip(self._first.tolist(), ends, strict=True)
        starts = np.concatenate([np.arange(first, end, window) for first, end in spans])
        at = np.arange(window)
        frames = starts[:, None] + at
        return [self._batch(frames[i : i + count], at, None) for i in range(0, len(frames), count)]

    def _starts(self, rng: np.random.Generator, count: int) -> Array:
        """Return the first frames of random windows, a part of them around active frames."""
        starts = self._helped_starts(rng, count)
        if self._config.active and len(self._active):
            frames = self._active[rng.integers(len(self._active), size=count)]
            before = frames - rng.integers(self._config.window, size=count)
            around = rng.uniform(size=count) < self._config.active
            starts = np.where(around, np.maximum(before, self._begin[frames]), starts)
        return starts

    def _helped_starts(self, rng: np.random.Generator, count: int) -> Array:
        """Return random frames, as many of interventions as configured."""
        share = self._config.interventions.share
        if share is None or not all(map(len, self._kinds)):
            return rng.integers(len(self), size=count)
        helped = rng.binomial(count, share)
        parts = zip(self._kinds, (helped, count - helped), strict=True)
        return np.concatenate([rng.choice(frames, size=size) for frames, size in parts])

    def _steps(self, rng: np.random.Generator, count: int) -> Array:
        """Return the steps (count, window) of windows; where one stands still, one is repeated."""
        window = self._config.window
        steps = np.tile(np.arange(window), (count, 1))
        if self._config.standstill:
            still = rng.uniform(size=count) < self._config.standstill
            ends = np.where(still, rng.integers(window, size=count), window)
            steps = np.minimum(steps, ends[:, None])
        return steps

    def _within(self, frames: Array) -> Array:
        """Return the frames (b, t) of windows, the last one for those beyond its episode's end."""
        found: Array = np.minimum(frames, self._last[frames[:, :1]])
        return found

    def _batch(self, frames: Array, at: Array, moves: Array | None) -> Batch:
        valid = frames <= self._last[frames[:, :1]]
        index = self._tensor(self._within(frames))
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
