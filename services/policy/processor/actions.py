"""How a policy says where the hands shall be: pose differences, or chunks of absolute set-points.

Each representation encodes the set-points of an episode for training and decodes a network's answer
in service, so that both mean the same. Poses are in the body frame; quaternions are (w, x, y, z).
"""

from collections.abc import Mapping
from math import ceil
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from common.episodes.columns import RATE
from common.robot.kinematics import FORWARD_HAND
from common.robot.pose import Pose
from common.robot.rotations import multiply, nearer_sign, normalised, rotate, rotation_between
from common.robot.workspace import clamp_to_workspace
from common.schemas import ControlState
from common.schemas.arrays import Float64Array as Array
from services.policy.configuration import ChunkConfig, DifferenceConfig

WINDOW = 0.3
"""Time over which motion is judged [s]."""
MOVING_SPEED = 0.03
"""A hand that is faster moves [m/s]."""
MOVING_TURN = 0.15
"""A hand that turns faster moves [rad/s]."""
_SIDES = ("left", "right")
_HAND = (slice(0, 7), slice(7, 14))


class Command(NamedTuple):
    """A set-point of hands and neck.

    Attributes:
        hands: (14,) position [m] and quaternion of left and right hand in the body frame.
        neck: head pitch, positive looks down [rad].
    """

    hands: Array
    neck: float


class Representation(Protocol):
    """A way to write set-points as numbers for a network.

    Attributes:
        shape: steps, and numbers of each step.
    """

    shape: tuple[int, int]

    def frames(self, active: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return, for each of T frames, the frames (T, steps) that it is to predict.

        Args:
            active: (T,) what :func:`active_frames` returns of an episode.
        """

    def encode(self, hands: Array, neck: Array, frames: NDArray[np.int64]) -> Array:
        """Return the actions (T, steps, numbers) of an episode.

        Args:
            hands: (T, 14).
            neck: (T,) the column ``action/neck`` [rad].
            frames: (T, steps) as :meth:`frames` returns them.
        """

    def decode(self, action: Array, previous: Command) -> list[Command]:
        """Return the set-points that an ``action`` (steps, numbers) means, within the workspace.

        Args:
            action: what :meth:`encode` returns of one frame.
            previous: set-point of the frame before.
        """


class PoseDifferences:
    """The next set-point relative to the previous one, the paper's representation.

    For each hand: its next pose in the frame of its previous set-point, whose origin and axes are
    those of the set-point, not those of the measured hand. Position [m], and the quaternion whose
    scalar part is not negative. The first set-point of an episode follows itself. The neck is not
    predicted; it stays where it is, as in the paper.
    """

    shape = DifferenceConfig().shape

    def frames(self, active: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return each frame itself (T, 1)."""
        return np.arange(len(active))[:, None]

    def encode(self, hands: Array, neck: Array, frames: NDArray[np.int64]) -> Array:
        """Return the differences (T, 1, 14)."""
        del neck, frames
        before = np.concatenate((hands[:1], hands[:-1]))
        pairs = zip(before, hands, strict=True)
        found = [[_difference(a[s], b[s]) for s in _HAND] for a, b in pairs]
        return np.reshape(found, (len(hands), *self.shape))

    def decode(self, action: Array, previous: Command) -> list[Command]:
        """Return the one set-point."""
        hands = [_follow(previous.hands[s], action[0, s]) for s in _HAND]
        return [Command(_allowed(hands), previous.neck)]


class AbsoluteChunks:
    """The next set-points in the body frame.

    For each hand: position [m], and rotation vector [rad], about the body's axes, from a hand that
    points straight ahead; then the neck's pitch [rad]. At the end of an episode its last set-point
    is repeated.
    """

    def __init__(self, config: ChunkConfig) -> None:
        self.shape = config.shape
        self._active_time = config.active_time

    def frames(self, active: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return the next frames (T, steps), in active time the active ones."""
        count = len(active)
        counted = active if self._active_time else np.ones(count, dtype=np.bool_)
        # Where the frames run out, the last one is repeated.
        later = np.concatenate((np.flatnonzero(counted), np.full(self.shape[0], count - 1)))
        first = np.searchsorted(later, np.arange(count))
        return np.asarray(later[first[:, None] + np.arange(self.shape[0])], dtype=np.int64)

    def encode(self, hands: Array, neck: Array, frames: NDArray[np.int64]) -> Array:
        """Return the set-points (T, steps, 13)."""
        rows: Array = np.concatenate((absolute(hands), neck[:, None]), axis=1)[frames]
        return rows

    def decode(self, action: Array, previous: Command) -> list[Command]:
        """Return the set-points of the chunk."""
        del previous
        return [
            Command(_allowed([_pose(row[:6]), _pose(row[6:12])]), float(row[12])) for row in action
        ]


def representation(config: DifferenceConfig | ChunkConfig) -> Representation:
    """Return the representation that a configuration chooses."""
    return PoseDifferences() if isinstance(config, DifferenceConfig) else AbsoluteChunks(config)


def absolute(hands: Array) -> Array:
    """Return hand poses (..., 14) as positions and rotation vectors (..., 12).

    The rotation vectors [rad] are about the body's axes, from a hand that points straight ahead.
    """
    rows = [
        np.concatenate(
            [
                np.concatenate((row[s][:3], rotation_between(FORWARD_HAND, row[s][3:])))
                for s in _HAND
            ]
        )
        for row in hands.reshape(-1, 14)
    ]
    return np.reshape(rows, (*hands.shape[:-1], 12))


def active_frames(arrays: Mapping[str, Any]) -> NDArray[np.bool_]:
    """Return which of an episode's T frames count in active time: something moves, and is meant to.

    A robot that walks moves: hands that rest meanwhile are to rest then, for what they do after the
    last gait would be done before the robot is where it is to be done. A hand that is knocked off
    its way (the column ``action/slip``) is no example; its way back is.

    Args:
        arrays: columns of the episode.
    """
    moves = moving(np.asarray(arrays["action/hands"]), np.asarray(arrays["action/grasp"]))
    walks = np.asarray(arrays["observation/control_state"]) > ControlState.BALANCE
    # Older files have no such column, or NaN.
    slips = np.asarray(arrays.get("action/slip", np.zeros(len(moves)))) > 0.0
    active: NDArray[np.bool_] = (moves | walks) & ~slips
    return active


def moving(hands: Array, grasp: Array) -> NDArray[np.bool_]:
    """Return in which of T frames a hand or a gripper moves, judged over the last 0.3 s.

    Looking back, the first moving frame after a pause has left it: from a pause the next moving
    frames lead away, which is what a policy that paused there has to learn.

    Args:
        hands: (T, 14) hand set-points.
        grasp: (T, 2) gripper set-points.
    """
    before = np.maximum(np.arange(len(hands)) - ceil(WINDOW * RATE), 0)
    moves: NDArray[np.bool_] = np.any(grasp[before] != grasp, axis=1)
    for s in _HAND:
        now, then = hands[:, s], hands[before, s]
        moves |= np.linalg.norm(now[:, :3] - then[:, :3], axis=1) > MOVING_SPEED * WINDOW
        cosine = np.minimum(np.abs(np.sum(now[:, 3:] * then[:, 3:], axis=1)), 1.0)
        moves |= 2.0 * np.arccos(cosine) > MOVING_TURN * WINDOW
    return moves


def _difference(previous: Array, following: Array) -> Array:
    step = Pose(previous[:3], previous[3:]).local_pose(Pose(following[:3], following[3:]))
    return np.concatenate((step.position, nearer_sign(step.quaternion, np.eye(4)[0])))


def _follow(previous: Array, difference: Array) -> Array:
    frame = Pose(previous[:3], previous[3:])
    quaternion = normalised(multiply(frame.quaternion, normalised(difference[3:])))
    return np.concatenate((frame.apply(difference[:3]), quaternion))


def _pose(row: Array) -> Array:
    return np.concatenate((row[:3], rotate(FORWARD_HAND, row[3:])))


def _allowed(hands: list[Array]) -> Array:
    """Return both poses (14,) as the column ``action/hands`` would have them."""
    parts = [
        part
        for side, hand in zip(_SIDES, hands, strict=True)
        for part in (clamp_to_workspace(side, hand[:3]), nearer_sign(hand[3:], FORWARD_HAND))
    ]
    return np.concatenate(parts)
