"""What the operator sees: torso, hands and objects, as late as its link makes them."""

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
"""Share of a new picture in what the operator takes for the torso's place."""


def hand_pose(
    x: float, y: float, z: float, roll: float = 0.0, pitch: float = 0.0, yaw: float = 0.0
) -> Pose:
    """A hand that points ahead, turned: positive pitch points it down, positive yaw left."""
    return Pose(np.array([x, y, z]), hand_quaternion(roll, pitch, yaw))


def easy_yaw(side: str, y: float) -> float:
    """Yaw [rad] at which a level hand reaches ``y`` [m] of the body frame with ease.

    By inverse kinematics within the arm's limits, x 0.28 to 0.44 m, z -0.1 to 0.18 m: straight
    ahead at 0.2 m, turned inward by 15 degrees at 0.1 m and by 30 at the middle, outward by 7
    degrees at 0.3 m.
    """
    sign = 1.0 if side == "left" else -1.0
    inward, outward = 2.9 * (sign * y - 0.19), 1.5 * (sign * y - 0.22)
    return sign * float(np.clip(inward, -0.8, 0.0) + np.clip(outward, 0.0, 0.2))


@dataclass(frozen=True)
class Sight:
    """One picture.

    Attributes:
        stamp: robot time of the picture [ns].
        torso: body frame in world.
        hands: by side, in the body frame.
        objects: what the scene shows and marks, in world.
        joints: hinges and slides of the scene [rad, m].
        balancing: the controller stands on both feet, no gait in progress.
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

    def thing(self, name: str) -> Pose:
        """Where an object or mark is, in world.

        Raises:
            TeleopError: it is not in the picture.
        """
        if name not in self.objects:
            shown = ", ".join(self.objects) or "nothing"
            raise TeleopError(f"expected to see {name!r} in the scene, got {shown}")
        return self.objects[name]

    def in_body(self, pose: Pose) -> Pose:
        """A pose of the world in the body frame."""
        return self.torso.local_pose(pose)

    def hand_in_world(self, side: str) -> Array:
        """Where a hand is (3,) [m]."""
        return self.torso.apply(self.hands[side].position)


class Eyes:
    """Makes pictures of the messages that have arrived; noise is smoothed as eyes do it."""

    def __init__(self) -> None:
        self._torso: Pose | None = None
        self._stamp = -1

    def see(
        self, state: PlantState | None, scene: SceneState | None, control: ControllerState | None
    ) -> Sight | None:
        """The picture as it is now; None while there is none yet."""
        if state is None:
            return None
        objects = {} if scene is None else {p.name: p for p in (*scene.objects, *scene.marks)}
        return Sight(
            stamp=state.header.stamp,
            torso=self._place(state),
            hands={side: hand_in_body(side, state.joint_position) for side in SIDES},
            objects={n: Pose(p.position, p.quaternion) for n, p in objects.items()},
            joints={} if scene is None else {j.name: j.position for j in scene.joints},
            balancing=control is not None and control.state is ControlState.BALANCE,
            completed=0 if control is None else control.gaits_completed,
            resets=state.reset_count,
        )

    def _place(self, state: PlantState) -> Pose:
        new = Pose(state.base_position, state.base_quaternion)
        old = self._torso
        if old is None or float(np.linalg.norm(new.position - old.position)) > 0.2:
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
