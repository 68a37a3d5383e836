"""Motor servo: motor torques from a joint command, as a motor driver computes them at its rate.

All quantities are per motor (25). A knee motor turns two hinges, jp = jd, with one torque T on
each: its coordinate is (jp + jd) / 2, its command the mean of the two hinges' commands, and its
limit that of one hinge.
"""

from dataclasses import dataclass

import numpy as np

from common.plant.config import TorqueMode
from common.robot.joints import (
    EFFORT_RATED,
    EFFORT_RELAXED,
    MOTOR_TO_JOINT,
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

_MOTORS = np.arange(NUM_MOTORS)
_POSITION = slice(0, NUM_MOTORS)
_VELOCITY = slice(NUM_MOTORS, 2 * NUM_MOTORS)
_TIME = 2 * NUM_MOTORS


@dataclass(frozen=True, slots=True)
class Target:
    """Control law of all motors.

    Attributes:
        stamp_ns: robot time from which the set-point is extrapolated [ns].
        law: (25, 53) matrix; torque = law · (position, velocity, 1, h, h²), h since the stamp [s].
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
    dq_cmd = dq* + ddq* h is linear in (q, dq, 1, h, h²), so that each physics step costs one
    matrix-vector product.

    Args:
        stamp_ns: robot time at which the set-point is exact [ns].
        position: (27,) [rad].
        velocity: (27,) [rad/s].
        acceleration: (27,) [rad/s²].
        torque: (27,) feed-forward [N·m].
        stiffness: (27,) [N·m/rad].
        damping: (27,) [N·m·s/rad].
    """
    joint_law = np.array(
        (
            -stiffness,
            -damping,
            torque + stiffness * position + damping * velocity,
            stiffness * velocity + damping * acceleration,
            0.5 * stiffness * acceleration,
        )
    )
    terms = joint_law @ JOINT_TO_MOTOR.T
    law = np.zeros((NUM_MOTORS, _TIME + 3))
    law[_MOTORS, _MOTORS] = terms[0]
    law[_MOTORS, NUM_MOTORS + _MOTORS] = terms[1]
    law[:, _TIME:] = terms[2:].T
    return Target(stamp_ns, law)


def torque_limit(mode: TorqueMode) -> Array:
    """Return the largest motor torque (25,); for a knee that of one hinge [N·m]."""
    return JOINT_TO_MOTOR @ (EFFORT_RATED if mode is TorqueMode.RATED else EFFORT_RELAXED)


class Servo:
    """Applies a :class:`Target` to measured motors, within torque and position limits.

    Attributes:
        limit: (25,) torque limit [N·m].
        position: (25,) measured motor coordinates [rad], written by the caller before each step.
        velocity: (25,) [rad/s], likewise.
        saturated_steps: calls of :meth:`torque` in which a motor was at its torque limit.
    """

    def __init__(self, mode: TorqueMode) -> None:
        self.limit = torque_limit(mode)
        self._lowest = -self.limit
        self._input = np.zeros(_TIME + 3)
        self._input[_TIME] = 1.0
        self.position = self._input[_POSITION]
        self.velocity = self._input[_VELOCITY]
        self.saturated_steps = 0
        self._lower = JOINT_TO_MOTOR @ POSITION_LOWER
        self._upper = JOINT_TO_MOTOR @ POSITION_UPPER
        self._wanted = np.zeros(NUM_MOTORS)
        self._inside = np.zeros(NUM_MOTORS)

    def torque(self, target: Target, now_ns: int, out: Array) -> None:
        """Write the motor torques of one physics step into ``out``.

        Args:
            target: control law.
            now_ns: robot time [ns].
            out: (25,) torques [N·m].
        """
        h = min(max(now_ns - target.stamp_ns, 0), EXTRAPOLATION_LIMIT_NS) * 1e-9
        self._input[_TIME + 1] = h
        self._input[_TIME + 2] = h * h
        wanted = target.law.dot(self._input, out=self._wanted)
        np.maximum(wanted, self._lowest, out=out)
        np.minimum(out, self.limit, out=out)
        # Comparing bytes is several times cheaper than an element-wise test, 1000 times a second.
        if out.tobytes() != wanted.tobytes():
            self.saturated_steps += 1
        inside = np.maximum(self.position, self._lower, out=self._inside)
        np.minimum(inside, self._upper, out=inside)
        if inside.tobytes() != self.position.tobytes():
            self._spare_stops(self.position - inside, out)

    @staticmethod
    def _spare_stops(beyond: Array, tau: Array) -> None:
        """Fade torques (25,) that push motors further ``beyond`` (25,) their limits [N·m, rad]."""
        outward = beyond * tau > 0.0
        tau[outward] *= np.maximum(0.0, 1.0 - np.abs(beyond[outward]) / LIMIT_FADE)
