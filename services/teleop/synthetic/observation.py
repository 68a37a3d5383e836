"""What the synthetic operator observes: torso, hands and objects, delayed by its feedback link."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from common.robot.kinematics import hand_in_body
from common.robot.pose import Pose
from common.robot.rotations import normalised
from common.schemas import ControllerState, ControlState, PlantState, SceneState
from common.schemas.arrays import Float64Array as Array
from services.teleop.errors import TeleopError
from services.teleop.targets.hand import SIDES, hand_quaternion

SMOOTHING = 0.5
"""Weight of a new state in the estimate of the torso's pose."""
JUMP = 0.2
"""Change of the torso's position above which the estimate starts anew [m]."""


def hand_pose(
    x: float, y: float, z: float, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0
) -> Pose:
    """Return a pose of a hand, rotated from pointing ahead: positive pitch down, positive yaw left.

    Args:
        x: position [m].
        y: position [m].
        z: position [m].
        roll: about body x [rad].
        pitch: about body y [rad].
        yaw: about body z [rad].
    """
    return Pose(np.array([x, y, z]), hand_quaternion(roll, pitch, yaw))


def easy_yaw(side: str, y: float) -> float:
    """Return the yaw at which a level hand reaches ``y`` [m] of the body frame well [rad].

    By inverse kinematics within the arm's limits, for x of 0.28 to 0.44 m and z of -0.1 to 0.18 m:
    straight ahead at 0.2 m, turned inward by 15 degrees at 0.1 m and by 30 in the middle, outward
    by 7 degrees at 0.3 m.
    """
    sign = 1.0 if side == "left" else -1.0
    inward, outward = 2.9 * (sign * y - 0.19), 1.5 * (sign * y - 0.22)
    return sign * float(np.clip(inward, -0.8, 0.0) + np.clip(outward, 0.0, 0.2))


@dataclass(frozen=True)
class Observation:
    """One observation of robot and scene.

    Attributes:
        stamp: robot time of the state [ns].
        torso: body frame in world.
        hands: robot's hands in the body frame, by side.
        objects: objects and marks of the scene in world, by name.
        joints: hinges and slides of the scene by name [rad, m].
        balancing: whether the controller balances without a gait in progress.
        completed: gaits completed.
        resets: of the plant.
    """

    stamp: int
    torso: Pose
    hands: Mapping[str, Pose]
    objects: Mapping[str, Pose] = field(default_factory=dict)
    joints: Mapping[str, float] = field(default_factory=dict)
    balancing: bool = False
    completed: int = 0
    resets: int = 0

    def pose_of(self, name: str) -> Pose:
        """Return the pose of an object or mark in world.

        Raises:
            TeleopError: the scene does not show it.
        """
        if name not in self.objects:
            shown = ", ".join(self.objects) or "nothing"
            raise TeleopError(f"expected to see {name!r} in the scene, got {shown}")
        return self.objects[name]

    def in_body(self, pose: Pose) -> Pose:
        """Return a pose of the world in the body frame."""
        return self.torso.local_pose(pose)

    def hand_in_world(self, side: str) -> Array:
        """Return the position (3,) of a hand in world [m]."""
        return self.torso.apply(self.hands[side].position)


class Observer:
    """Makes observations from messages and smooths noise in the torso's pose."""

    def __init__(self) -> None:
        self._torso: Pose | None = None
        self._stamp = -1

    def observe(
        self, state: PlantState | None, scene: SceneState | None, control: ControllerState | None
    ) -> Observation | None:
        """Return the present observation; None without a state."""
        if state is None:
            return None
        objects = {} if scene is None else {p.name: p for p in (*scene.objects, *scene.marks)}
        return Observation(
            stamp=state.header.stamp,
            torso=self._smoothed_torso(state),
            hands={side: hand_in_body(side, state.joint_position) for side in SIDES},
            objects={n: Pose(p.position, p.quaternion) for n, p in objects.items()},
            joints={} if scene is None else {j.name: j.position for j in scene.joints},
            balancing=control is not None and control.state is ControlState.BALANCE,
            completed=0 if control is None else control.gaits_completed,
            resets=state.reset_count,
        )

    def _smoothed_torso(self, state: PlantState) -> Pose:
        new = Pose(state.base_position, state.base_quaternion)
        old = self._torso
        if old is None or float(np.linalg.norm(new.position - old.position)) > JUMP:
            self._torso = new
        elif state.header.stamp != self._stamp:
            sign = 1.0 if float(old.quaternion @ new.quaternion) >= 0.0 else -1.0
            self._torso = Pose(
                old.position + SMOOTHING * (new.position - old.position),
                normalised((1.0 - SMOOTHING) * old.quaternion + SMOOTHING * sign * new.quaternion),
            )
        self._stamp = state.header.stamp
        assert self._torso is not None
        return self._torso
