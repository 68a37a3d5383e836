"""Motor servo: motor torques from a joint command, as a motor driver computes them at its rate.

All quantities are per motor (25). A knee motor turns two hinges, jp = jd, with one torque T on
each: its coordinate is (jp + jd) / 2, its command the mean of the two hinges' commands, and its
limit that of one hinge.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from common.native import kernel
from common.plant.config import TorqueMode
from common.robot.joints import (
    EFFORT_RATED,
    EFFORT_RELAXED,
    MOTOR_TO_JOINT,
    NUM_JOINTS,
    NUM_MOTORS,
    POSITION_LOWER,
    POSITION_UPPER,
)
from common.schemas.arrays import Float64Array as Array

EXTRAPOLATION_LIMIT_NS = 30_000_000
"""Longest extrapolation of a set-point from its stamp [ns]."""

LIMIT_FADE = 0.02
"""Distance beyond a joint's limit at which an outward torque has faded to zero [rad]."""

JOINT_TO_MOTOR: Array = (MOTOR_TO_JOINT / MOTOR_TO_JOINT.sum(axis=0)).T
"""(25, 27) mean over the joints of a motor, for positions, velocities and torques."""

_TO_MOTORS: Array = np.ascontiguousarray(JOINT_TO_MOTOR.T)
_TERMS = 5
"""Of a law: what each motor makes of its position, its velocity, 1, h and h²."""
_servo: Any = kernel("common.plant._servo")


@dataclass(frozen=True, slots=True)
class Target:
    """Control law of all motors.

    Attributes:
        stamp_ns: robot time from which the set-point is extrapolated [ns].
        law: (5, 25) factors; torque = law · (position, velocity, 1, h, h²), h since the stamp [s].
    """

    stamp_ns: int
    law: Array


def motor_target(
    stamp_ns: int,
    position: Array,
    velocity: Array,
    acceleration: Array,
    torque: Array,
    stiffness: Array,
    damping: Array,
) -> Target:
    """Return the motors' control law for a joint command.

    tau = tau_ff + kp (q_cmd - q) + kd (dq_cmd - dq) with q_cmd = q* + dq* h + ddq* h² / 2 and
    dq_cmd = dq* + ddq* h is linear in (q, dq, 1, h, h²), so that each physics step costs few
    operations.

    Args:
        stamp_ns: robot time at which the set-point is exact [ns].
        position: (27,) [rad].
        velocity: (27,) [rad/s].
        acceleration: (27,) [rad/s²].
        torque: (27,) feed-forward [N·m].
        stiffness: (27,) [N·m/rad].
        damping: (27,) [N·m·s/rad].
    """
    if _servo is not None:
        law = np.empty((_TERMS, NUM_MOTORS))
        _servo.law(position, velocity, acceleration, torque, stiffness, damping, _TO_MOTORS, law)
        return Target(stamp_ns, law)
    terms = np.empty((_TERMS, NUM_JOINTS))
    np.negative(stiffness, out=terms[0])
    np.negative(damping, out=terms[1])
    terms[2] = torque + stiffness * position + damping * velocity
    terms[3] = stiffness * velocity + damping * acceleration
    terms[4] = 0.5 * stiffness * acceleration
    return Target(stamp_ns, terms @ _TO_MOTORS)


def torque_limit(mode: TorqueMode) -> Array:
    """Return the largest motor torque (25,); for a knee that of one hinge [N·m]."""
    return JOINT_TO_MOTOR @ (EFFORT_RATED if mode is TorqueMode.RATED else EFFORT_RELAXED)


class Servo:
    """Applies a :class:`Target` to measured motors, within torque and position limits.

    Attributes:
        lowest, highest: (50,) limits of torques [N·m], then positions [rad].
        position: (25,) measured motor coordinates [rad], written by the caller before each step.
        velocity: (25,) [rad/s], likewise.
        saturated_steps: calls of :meth:`torque` in which a motor was at its torque limit.
    """

    def __init__(self, mode: TorqueMode) -> None:
        limit = torque_limit(mode)
        # Wanted torques, then the factors of a law: torques and positions are side by side, so that
        # one operation bounds both.
        values = np.zeros((1 + _TERMS) * NUM_MOTORS)
        self._wanted, self._factors = values[:NUM_MOTORS], values[NUM_MOTORS:].reshape(_TERMS, -1)
        self._factors[2] = 1.0
        self._products = np.zeros_like(self._factors)
        self.position, self.velocity = self._factors[:2]
        self.saturated_steps = 0
        self._free = values[: 2 * NUM_MOTORS]
        self.lowest = np.concatenate((-limit, JOINT_TO_MOTOR @ POSITION_LOWER))
        self.highest = np.concatenate((limit, JOINT_TO_MOTOR @ POSITION_UPPER))
        self._bounded = np.zeros(2 * NUM_MOTORS)
        self._torque, self._inside = self._bounded[:NUM_MOTORS], self._bounded[NUM_MOTORS:]

    def torque(self, target: Target, now_ns: int, out: Array) -> None:
        """Write the motor torques of one physics step into ``out``.

        Args:
            target: control law.
            now_ns: robot time [ns].
            out: (25,) torques [N·m].
        """
        h = min(max(now_ns - target.stamp_ns, 0), EXTRAPOLATION_LIMIT_NS) * 1e-9
        self._factors[3] = h
        self._factors[4] = h * h
        # Not a matrix product, whose last bits differ between libraries: compiled code has to get
        # the same ones.
        np.multiply(target.law, self._factors, out=self._products)
        np.add.reduce(self._products, axis=0, out=self._wanted)
        np.maximum(self._free, self.lowest, out=self._bounded)
        np.minimum(self._bounded, self.highest, out=self._bounded)
        out[:] = self._torque
        # Comparing bytes is several times cheaper than an element-wise test, 1000 times a second.
        if self._bounded.tobytes() != self._free.tobytes():
            self.saturated_steps += self._torque.tobytes() != self._wanted.tobytes()
            self._spare_stops(self.position - self._inside, out)

    @staticmethod
    def _spare_stops(beyond: Array, tau: Array) -> None:
        """Fade torques (25,) that push motors further ``beyond`` (25,) their limits [N·m, rad]."""
        outward = beyond * tau > 0.0
        tau[outward] *= np.maximum(0.0, 1.0 - np.abs(beyond[outward]) / LIMIT_FADE)
