"""The processor: one object between data and network, the same in training and in service."""

from collections.abc import Iterable, Mapping
from functools import cached_property
from typing import Annotated, Any, NamedTuple, Self

import numpy as np
from numpy.typing import NDArray
from pydantic import Field, model_validator

from common.schemas import ControlState
from common.schemas.arrays import Float64Array as Array
from services.policy.configuration import (
    ChunkConfig,
    DifferenceConfig,
    InputConfig,
    PolicySettings,
    StrictModel,
)
from services.policy.errors import ProcessorError
from services.policy.processor.actions import (
    Command,
    Representation,
    absolute,
    active_frames,
    representation,
)
from services.policy.processor.statistics import Statistics
from services.policy.processor.targets import Targets, gait_targets

Arrays = Mapping[str, Any]
"""Columns of an episode, or of one frame of it, by path.

``scene`` has the numbers of the scene that the policy is told, ``estimated`` the true values of
those that it estimates.
"""

_STATE = "observation/control_state"
ESTIMATED = "estimated"
"""The column of the true values of the numbers that a network estimates."""
INPUT_FLOOR = 0.01
"""Least scale of a number of the observation, in its unit: m, rad/s, 1."""
ACTION_FLOOR = {"differences": 1e-4, "chunks": 0.02}
"""Least scale of a number of the action, in its unit: m, rad, 1.

Differences are of millimetres. Of absolute set-points, a hand that rests through all demonstrations
varies by millimetres too, and with a smaller scale its trembling would be what is learned first.
"""
SCENE_FLOOR = 0.01
"""Least scale of an estimated number of the scene, in its unit: m, rad, 1."""


class Decision(NamedTuple):
    """What a network answers to one frame, as arrays that can travel in a message.

    Attributes:
        hands: (steps, numbers) float32, normalised actions of hands and neck.
        grasp: (steps, 2) float32, probability that a gripper shall be closed.
        gait: (7,) float32, probability of no gait and of each gait.
    """

    hands: NDArray[np.float32]
    grasp: NDArray[np.float32]
    gait: NDArray[np.float32]


class Processor(StrictModel):
    """Turns columns into observation vectors and targets, and decisions into set-points.

    Attributes:
        inputs: what the policy observes.
        actions: how it says where the hands shall be.
        hazard_frames: as in :class:`~services.policy.configuration.LossConfig`.
        observation: statistics of the measured numbers of the observation vector.
        action: statistics of the numbers of one step.
        scene: statistics of the numbers of the scene that the network estimates; None: none.
    """

    inputs: InputConfig
    actions: Annotated[DifferenceConfig | ChunkConfig, Field(discriminator="kind")]
    hazard_frames: int = 0
    observation: Statistics
    action: Statistics
    scene: Statistics | None = None

    @model_validator(mode="after")
    def _statistics_fit(self) -> Self:
        expected = (self.inputs.measured_width, self.actions.shape[1], len(self.inputs.estimated))
        scene = 0 if self.scene is None else self.scene.width
        got = (self.observation.width, self.action.width, scene)
        if expected != got:
            raise ValueError(
                f"expected statistics of {expected[0]} measured, {expected[1]} action and "
                f"{expected[2]} estimated numbers, got {got[0]}, {got[1]} and {got[2]}"
            )
        return self

    @classmethod
    def fit(cls, config: PolicySettings, episodes: Iterable[Arrays]) -> Self:
        """Return the processor of a policy, with statistics of its data set.

        Args:
            config: of the policy.
            episodes: columns of each episode.

        Raises:
            ProcessorError: a column is missing or has another width, or there is no episode.
        """
        chosen = representation(config.actions)
        observed: list[Array] = []
        acted: list[Array] = []
        shown: list[Array] = []
        for arrays in episodes:
            observed.append(_measured(config.inputs, arrays, _previous(arrays)))
            acted.append(_actions(chosen, arrays)[0])
            if config.inputs.estimated:
                shown.append(_column(arrays, ESTIMATED))
        if not observed:
            raise ProcessorError("expected episodes to compute statistics of, got none")
        return cls(
            inputs=config.inputs,
            actions=config.actions,
            hazard_frames=config.loss.hazard_frames,
            observation=Statistics.of(np.concatenate(observed), INPUT_FLOOR),
            action=Statistics.of(np.concatenate(acted), ACTION_FLOOR[config.actions.kind]),
            scene=Statistics.of(np.concatenate(shown), SCENE_FLOOR) if shown else None,
        )

    def frame(self, frame: Arrays, previous: Command) -> NDArray[np.float32]:
        """Return the observation vector (n,) of one frame in service.

        Args:
            frame: columns of :func:`common.episodes.observation.observation`.
            previous: set-point of the frame before, or where the hands are at the start.

        Raises:
            ProcessorError: a column is missing or has another width.
        """
        return self._vector(frame, previous.hands)

    def episode(self, arrays: Arrays) -> NDArray[np.float32]:
        """Return the observation vectors (T, n) of an episode.

        Raises:
            ProcessorError: a column is missing or has another width.
        """
        return self._vector(arrays, _previous(arrays))

    def targets(self, arrays: Arrays) -> Targets:
        """Return what a network is to learn of an episode."""
        actions, frames = _actions(self._representation, arrays)
        gait, counts = gait_targets(
            np.asarray(arrays["action/locomotion"]),
            np.asarray(arrays["observation/control_state"]),
            self.hazard_frames,
        )
        closed = np.asarray(arrays["action/grasp"])[frames] > 0.5
        return Targets(self.action.normalise(actions), closed.astype(np.float32), gait, counts)

    def commands(self, decision: Decision, previous: Command) -> list[Command]:
        """Return the set-points of hands and neck that a decision means.

        Args:
            decision: of the network.
            previous: set-point of the frame before.
        """
        return self._representation.decode(self.action.restore(decision.hands), previous)

    def _vector(self, arrays: Arrays, previous: Array) -> NDArray[np.float32]:
        measured = self.observation.normalise(_measured(self.inputs, arrays, previous))
        state = np.eye(len(ControlState), dtype=np.float32)[_column(arrays, _STATE)]
        return np.concatenate((measured, state), axis=-1)

    @cached_property
    def _representation(self) -> Representation:
        return representation(self.actions)


def _actions(chosen: Representation, arrays: Arrays) -> tuple[Array, NDArray[np.int64]]:
    """Return actions (T, steps, numbers) and the frames (T, steps) that they are of."""
    hands, neck = np.asarray(arrays["action/hands"]), np.asarray(arrays["action/neck"])
    frames = chosen.frames(active_frames(arrays))
    return chosen.encode(hands, neck, frames), frames


def _previous(arrays: Arrays) -> Array:
    """Return the hand set-points (T, 14) of the frames before; the first one precedes itself."""
    hands = np.asarray(arrays["action/hands"])
    return np.concatenate((hands[:1], hands[:-1]))


def _measured(inputs: InputConfig, arrays: Arrays, previous: Array) -> Array:
    """Return the measured numbers (..., n), not normalised, of one frame or of many."""
    parts: list[Array] = []
    for name, width in inputs.parts.items():
        if name == _STATE:
            continue
        part = absolute(previous) if name == "previous_setpoint" else _column(arrays, name)
        if part.shape[-1] != width:
            raise ProcessorError(f"expected {width} numbers of {name}, got {part.shape[-1]}")
        parts.append(part)
    return np.concatenate(parts, axis=-1)


def _column(arrays: Arrays, name: str) -> Any:
    if name not in arrays:
        raise ProcessorError(
            f"expected {name}, which the policy observes, got only {', '.join(arrays)}"
        )
    return np.asarray(arrays[name])
