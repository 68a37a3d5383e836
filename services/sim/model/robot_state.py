"""Conversion between state messages and MuJoCo, in both directions."""

from typing import Any, Final

import mujoco
import numpy as np

from common.robot.joints import (
    GRIPPER_CLOSE_COMMAND,
    GRIPPER_STROKE,
    MOTOR_TO_JOINT,
    NUM_MOTORS,
)
from common.schemas import PlantState, SceneState
from common.schemas.arrays import Float64Array as Array
from services.sim.errors import SceneError
from services.sim.model.contacts import foot_normal_forces
from services.sim.model.world import Addresses

SQUEEZE_FROM: Final = 0.9
"""Closure from which on the command runs ahead of the jaw, up to the full grip force at 1."""

_MOTOR_OF_JOINT = MOTOR_TO_JOINT.argmax(axis=1)
"""(27,) index of the motor that turns each joint."""


def jaw_command(closure: float) -> float:
    """Return the finger position to command [m] for a closure, which is clipped to 0..1.

    Below :data:`SQUEEZE_FROM` it is the position itself, so that a half-closed command leaves
    a half-closed hand; above, it goes past contact so that the position servo squeezes.

    Args:
        closure: 0 open to 1 closed.
    """
    closed = min(max(closure, 0.0), 1.0)
    squeeze = max(closed - SQUEEZE_FROM, 0.0) / (1.0 - SQUEEZE_FROM)
    return GRIPPER_STROKE * (1.0 - closed) + GRIPPER_CLOSE_COMMAND * squeeze


def jaw_closure(finger: float) -> float:
    """Return the closure 0..1 of a finger's position [m]."""
    return min(max(1.0 - finger / GRIPPER_STROKE, 0.0), 1.0)


class RobotReader:
    """Reads what a state message says about the robot, from a ``mujoco.MjData``."""

    def __init__(self, data: Any, addresses: Addresses) -> None:
        """Prepare; ``addresses`` are those of the robot in the model."""
        self._data, self._feet = data, addresses.feet
        # Views of MuJoCo's memory, which it never moves.
        self._qpos, self._qvel, self._torque = data.qpos, data.qvel, data.ctrl[:NUM_MOTORS]
        self._positions = np.concatenate((np.arange(7), addresses.qpos))
        self._velocities = np.concatenate((np.arange(6), addresses.qvel))
        self._fingers = addresses.fingers_qpos.ravel()

    def read(self) -> dict[str, Array]:
        """Return the array fields of a :class:`~common.schemas.PlantState`, in their order."""
        position, velocity = self._qpos.take(self._positions), self._qvel.take(self._velocities)
        left, left_other, right, right_other = self._qpos.take(self._fingers).tolist()
        closure = (jaw_closure(0.5 * (left + left_other)), jaw_closure(0.5 * (right + right_other)))
        return {
            "base_position": position[:3],
            "base_quaternion": position[3:7],
            "base_linear_velocity": velocity[:3],
            "base_angular_velocity": velocity[3:6],
            "joint_position": position[7:],
            "joint_velocity": velocity[6:],
            "joint_torque": self._torque.take(_MOTOR_OF_JOINT),
            "gripper_closure": np.array(closure),
            "foot_normal_force": foot_normal_forces(self._data, self._feet),
        }


def show_state(
    model: Any,
    data: Any,
    addresses: Addresses,
    state: PlantState,
    objects: SceneState | None = None,
) -> None:
    """Set robot and scene of ``data`` to received states, for pictures: kinematics, no dynamics.

    Args:
        model: the ``mujoco.MjModel``.
        data: its ``mujoco.MjData``.
        addresses: of the robot in the model.
        state: of the robot.
        objects: state of the scene; None: the scene stays as it is.

    Raises:
        SceneError: ``objects`` belong to another scene than the model.
    """
    if objects is not None:
        scene_qpos = data.qpos[addresses.scene :]
        if len(objects.qpos) != scene_qpos.size:
            raise SceneError(
                f"cannot show the scene {objects.scene!r}: expected {scene_qpos.size} joint values "
                f"for this model, got {len(objects.qpos)}; use the same scene or task for plant "
                "and pictures"
            )
        scene_qpos[:] = objects.qpos
    data.qpos[:3] = state.base_position
    data.qpos[3:7] = state.base_quaternion
    data.qpos[addresses.qpos] = state.joint_position
    data.qpos[addresses.fingers_qpos] = GRIPPER_STROKE * (1.0 - state.gripper_closure[:, None])
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    mujoco.mj_camlight(model, data)
