"""From joint positions to the poses of feet and hands in the body frame, as a policy is given.

Whoever records demonstrations and whoever runs a policy must compute them alike, hence here. Needs
pinocchio, but only when the kinematics are built: not every service has it.
"""

from functools import cache
from typing import Any

import numpy as np

from common.errors import TrillError
from common.robot.frames import FOOT_FRAMES, FORWARD_HAND_IN_BODY, HAND_FRAMES
from common.robot.joints import FINGER_JOINTS, JOINT_NAMES, MJCF_PATH, NUM_JOINTS
from common.schemas.arrays import Float64Array as Array

USUAL_FOOT = np.array([1.0, 0.0, 0.0, 0.0])
USUAL_HAND = np.array(FORWARD_HAND_IN_BODY)
"""The sign of a quaternion is the one nearer to these."""


class BodyPosesError(TrillError):
    """The kinematics of feet and hands cannot be computed."""


def nearer(quaternion: Array, usual: Array) -> Array:
    """``quaternion`` (4,) or its negative, whichever is nearer to ``usual`` (4,)."""
    return -quaternion if float(quaternion @ usual) < 0.0 else quaternion


class BodyPoses:
    """Forward kinematics of feet and hands, the torso at the origin."""

    def __init__(self) -> None:
        """Read the robot's description.

        Raises:
            BodyPosesError: pinocchio is missing, or the description has other joints.
        """
        try:
            import pinocchio as pin
        except ImportError as error:
            raise BodyPosesError(
                "poses of feet and hands need pinocchio: pip install 'pin>=4.1,<5'"
            ) from error
        self._pin: Any = pin
        full = pin.buildModelFromMJCF(str(MJCF_PATH))
        # Hands are the sites on the wrists: where the fingers are makes no difference.
        fingers = [full.getJointId(name) for pair in FINGER_JOINTS.values() for name in pair]
        self._model: Any = pin.buildReducedModel(full, fingers, pin.neutral(full))
        if tuple(self._model.names)[2:] != JOINT_NAMES:
            raise BodyPosesError(
                f"expected the MJCF's joints to be {JOINT_NAMES}, got "
                f"{tuple(self._model.names)[2:]}; restore the order of common/robot/draco3.xml"
            )
        self._data = self._model.createData()
        self._q = np.array(pin.neutral(self._model))
        self._frames = [
            (self._model.getFrameId(frames[side]), usual)
            for frames, usual in ((FOOT_FRAMES, USUAL_FOOT), (HAND_FRAMES, USUAL_HAND))
            for side in ("left", "right")
        ]

    def of(self, joint_position: Array) -> Array:
        """Poses of left foot, right foot, left hand, right hand in the body frame.

        Args:
            joint_position: (27,) [rad].

        Returns:
            (28,) for each position [m] and quaternion (w, x, y, z).
        """
        self._q[-NUM_JOINTS:] = joint_position
        self._pin.framesForwardKinematics(self._model, self._data, self._q)
        parts: list[Array] = []
        for index, usual in self._frames:
            placement = self._data.oMf[index]
            x, y, z, w = self._pin.Quaternion(placement.rotation).coeffs().tolist()
            parts += [placement.translation, nearer(np.array([w, x, y, z]), usual)]
        return np.concatenate(parts)


@cache
def body_poses() -> BodyPoses:
    """The kinematics, built once a process."""
    return BodyPoses()
