"""Hand references: set-points within the workspace, joined with velocity feed-forward.

Set-points arrive at about 20 Hz. Each becomes a cubic Hermite segment that starts at the present
reference (position and velocity). It ends where the hand will be one set-point period later if the
motion goes on, by an estimate (operator_motion.py) that leaves out most of the trembling; it takes
longer than that if a speed limit asks for it. A steady motion is thus followed without lag; a stop
costs one period's overshoot. When set-points cease, the reference comes to rest at the last one.
"""

import numpy as np

from common.robot.rotations import matrix_from_rotation_vector, rotation_vector_from_matrix
from common.robot.workspace import clamp_to_workspace
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import HandConfig
from services.wbc.operator_motion import OperatorMotion
from services.wbc.references import PoseReference


class _Segment:
    """Cubic Hermite segment of the position and of a rotation vector.

    Args:
        start: time of its beginning [s].
        duration: [s].
        values: (2, 6) position and rotation vector at both ends [m, rad].
        rates: (2, 6) their time derivatives at both ends.
        base_rotation: (3, 3) rotation that the rotation vector turns.
    """

    def __init__(
        self, start: float, duration: float, values: Array, rates: Array, base_rotation: Array
    ) -> None:
        self.start, self.duration, self.base_rotation = start, duration, base_rotation
        (a, b), (va, vb) = values, rates * duration
        # The Hermite basis as powers of the normalised time.
        self._coefficients = np.array(
            (a, va, 3.0 * (b - a) - 2.0 * va - vb, 2.0 * (a - b) + va + vb)
        )

    def at(self, time: float) -> tuple[Array, Array, Array]:
        """Return value, rate and acceleration (6,); beyond the end the rate is constant."""
        s = min(max((time - self.start) / self.duration, 0.0), 1.0)
        pace = 1.0 / self.duration
        bend = pace * pace if s < 1.0 else 0.0
        powers = np.array(
            (
                (1.0, s, s * s, s * s * s),
                (0.0, pace, 2.0 * s * pace, 3.0 * s * s * pace),
                (0.0, 0.0, 2.0 * bend, 6.0 * s * bend),
            )
        )
        value, rate, acceleration = powers.dot(self._coefficients)
        beyond = time - self.start - self.duration
        if beyond > 0.0:
            value += rate * beyond
        return value, rate, acceleration


class HandReference:
    """Reference of one hand in the body frame; pure, driven by explicit times [s].

    It is the one place where set-points are kept within the workspace and their speed is limited.
    """

    def __init__(self, side: str, config: HandConfig) -> None:
        self._side = side
        self._config = config
        self._segment: _Segment | None = None
        self._target: tuple[Array, Array] | None = None
        self._target_time = 0.0
        self._motion: OperatorMotion | None = None
        self._stopped = True
        # Since the segment has ended in rest the reference no longer changes.
        self._rest: PoseReference | None = None

    @property
    def started(self) -> bool:
        """Whether a pose was set."""
        return self._target is not None

    @property
    def target(self) -> tuple[Array, Array]:
        """Last set-point within the workspace: position (3,) and rotation (3, 3)."""
        if self._target is None:
            raise ValueError("no hand set-point yet; call hold() or set() first")
        return self._target

    def hold(self, position: Array, rotation: Array, time: float) -> None:
        """Rest at a pose from ``time`` on; it may lie outside the workspace."""
        self._target, self._target_time, self._stopped = (position, rotation), time, True
        self._motion, self._rest = OperatorMotion(self._config, position, rotation), None
        value = np.concatenate((position, np.zeros(3)))
        self._segment = _Segment(time, 1.0, np.array([value, value]), np.zeros((2, 6)), rotation)

    def set(self, position: Array, rotation: Array, time: float) -> None:
        """Follow a set-point that arrived at ``time``.

        Args:
            position: (3,) in the body frame [m].
            rotation: (3, 3) hand to body.
            time: [s].
        """
        config = self._config
        position = clamp_to_workspace(self._side, position)
        if config.mode == "raw" or self._segment is None or self._motion is None:
            self.hold(position, rotation, time)
            return
        elapsed = max(time - self._target_time, 0.5 * config.setpoint_period)
        if elapsed <= config.stale_after:
            self._motion.update(position, rotation, elapsed)
        else:
            self._motion = OperatorMotion(config, position, rotation)
        motion = self._motion
        self._target, self._target_time, self._stopped = (position, rotation), time, False
        self._go(motion.position, motion.rotation, motion.rate, time)

    def _go(self, position: Array, rotation: Array, rate: Array, time: float) -> None:
        now = self.at(time)
        self._rest = None
        config = self._config
        period = config.setpoint_period
        end = clamp_to_workspace(self._side, position + rate[:3] * period)
        rate = rate.copy()
        rate[:3] = (end - position) / period
        turn = rotation_vector_from_matrix(rotation @ now.rotation.T) + rate[3:] * period
        distance = float(np.linalg.norm(end - now.position))
        angle = float(np.linalg.norm(turn))
        # The peak speed of a cubic from rest to rest is 1.5 times its mean.
        duration = max(
            period, 1.5 * distance / config.speed_max, 1.5 * angle / config.turn_rate_max
        )
        values = np.array([[*now.position, 0.0, 0.0, 0.0], [*end, *turn]])
        self._segment = _Segment(
            time, duration, values, np.array([now.velocity, rate]), now.rotation
        )

    def at(self, time: float) -> PoseReference:
        """Return the reference at ``time``: pose, velocity and acceleration in the body frame."""
        if self._segment is None:
            raise ValueError("no hand set-point yet; call hold() or set() first")
        if self._rest is not None:
            return self._rest
        silent = time - self._target_time
        expired = time > self._segment.start + self._segment.duration + self._config.setpoint_period
        if not self._stopped and (expired or silent > self._config.stale_after):
            self._stop(time)
        value, rate, acceleration = self._segment.at(time)
        rotation = matrix_from_rotation_vector(value[3:]).dot(self._segment.base_rotation)
        reference = PoseReference(value[:3], rotation, rate, acceleration)
        if self._stopped and time > self._segment.start + self._segment.duration:
            self._rest = reference
        return reference

    def _stop(self, time: float) -> None:
        """Come to rest at the last set-point, for the operator's motion is no longer known."""
        self._stopped = True
        position, rotation = self.target
        self._go(position, rotation, np.zeros(6), time)
