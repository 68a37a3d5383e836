"""Physics steps behind the motor servo, as many in a row as nobody has to decide anything in."""

import ctypes
import logging
import math
import os
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from common.native import kernel
from common.plant.config import PHYSICS_STEP_NS
from common.plant.servo import EXTRAPOLATION_LIMIT_NS, LIMIT_FADE, Servo, Target
from common.robot.joints import MOTOR_TO_JOINT, NUM_MOTORS
from services.sim.physics.divergence import FARTHEST, FASTEST, is_possible

FALLEN_HEIGHT = 0.5
"""Torso height below which the robot has fallen [m]."""
FALLEN_UPRIGHTNESS = math.cos(math.radians(41.0))
"""Cosine of the torso's tilt below which the robot has fallen."""

_PER_JOINT = 1.0 / MOTOR_TO_JOINT.sum(axis=0)
"""(25,) makes the mean over a motor's joints of their sum."""
_LOG = logging.getLogger(__name__)
_steps: Any = kernel("services.sim.physics._steps")


class PhysicsSteps:
    """Advances a ``mujoco.MjData`` under a control law; in compiled code where there is any.

    Both ways give the same bits.
    """

    def __init__(self, model: Any, data: Any, torso: int, servo: Servo) -> None:
        """Prepare.

        Args:
            model: the ``mujoco.MjModel``.
            data: the ``mujoco.MjData``.
            torso: id of the torso's body.
            servo: computes the motor torques, and counts saturated steps.
        """
        self._model, self._data, self._servo = model, data, servo
        # Views of MuJoCo's memory, which it never moves.
        self._qpos, self._qvel = data.qpos, data.qvel
        self._length = data.actuator_length[:NUM_MOTORS]
        self._velocity = data.actuator_velocity[:NUM_MOTORS]
        self._torque = data.ctrl[:NUM_MOTORS]
        self._rotation = data.xmat[torso]
        addresses = _addresses("mj_step1", "mj_step2", "mju_user_error") if _steps else None
        self._prepared = self._prepare(*addresses) if addresses else None

    def _prepare(self, step1: int, step2: int, user_error: int) -> Any:
        return _steps.prepare(
            step1=step1,
            step2=step2,
            user_error=user_error,
            error=mujoco.FatalError,
            model=self._model._address,
            data=self._data._address,
            torque=self._torque,
            length=self._length,
            velocity=self._velocity,
            qpos=self._qpos,
            qvel=self._qvel,
            rotation=self._rotation,
            per_joint=_PER_JOINT,
            lowest=self._servo.lowest,
            highest=self._servo.highest,
            step_ns=PHYSICS_STEP_NS,
            extrapolation_ns=EXTRAPOLATION_LIMIT_NS,
            fade=LIMIT_FADE,
            height=FALLEN_HEIGHT,
            uprightness=FALLEN_UPRIGHTNESS,
            farthest_squared=FARTHEST**2,
            fastest_squared=FASTEST**2,
        )

    def run(self, target: Target, now_ns: int, most: int, *, watch_fall: bool) -> tuple[int, bool]:
        """Advance by physics steps up to the first after which the state is worth a look.

        It is when the robot is down, or the physics may have diverged.

        Args:
            target: control law.
            now_ns: robot time of the first step [ns].
            most: most steps, at least one.
            watch_fall: whether it matters that the robot is down.

        Returns:
            the number of steps, and whether the state is worth a look after the last.
        """
        if self._prepared is not None:
            done, saturated, is_notable = _steps.run(
                self._prepared, target.law, target.stamp_ns, now_ns, most, watch_fall
            )
            self._servo.saturated_steps += saturated
            return done, is_notable
        for done in range(most):
            self._step(target, now_ns + done * PHYSICS_STEP_NS)
            if (watch_fall and self.is_down()) or not is_possible(self._qpos, self._qvel):
                return done + 1, True
        return most, False

    def _step(self, target: Target, now_ns: int) -> None:
        servo = self._servo
        # It also computes lengths and velocities of the actuators, which for a motor are sums.
        mujoco.mj_step1(self._model, self._data)
        np.multiply(self._length, _PER_JOINT, out=servo.position)
        np.multiply(self._velocity, _PER_JOINT, out=servo.velocity)
        servo.torque(target, now_ns, self._torque)
        mujoco.mj_step2(self._model, self._data)

    def is_down(self) -> bool:
        """Return whether the robot lies or leans as only a falling one does."""
        return float(self._qpos[2]) < FALLEN_HEIGHT or float(self._rotation[8]) < FALLEN_UPRIGHTNESS


def _addresses(*names: str) -> list[int] | None:
    """Return the addresses of symbols in the library that MuJoCo's package has loaded."""
    folder = Path(mujoco.__file__).parent
    for path in folder.glob("libmujoco.*"):
        try:
            library = ctypes.CDLL(str(path), mode=os.RTLD_NOLOAD | os.RTLD_NOW)
        except OSError:
            continue
        return [ctypes.addressof(ctypes.c_char.in_dll(library, name)) for name in names]
    _LOG.warning("the physics runs in Python: found no loaded libmujoco in %s", folder)
    return None
