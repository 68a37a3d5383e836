"""Estimate of an operator's hand pose and velocity from set-points with tremor.

It is an alpha-beta filter whose gain depends on the distance of a set-point from its prediction and
on the hand's speed: tremor is mostly averaged out, movements pass unfiltered. The gains of position
and velocity are related as in T. R. Benedict and G. W. Bordner, "Synthesis of an optimal set of
radar track-while-scan smoothing equations", IRE Trans. Automatic Control 7 (1962), so that steady
motion is followed without lag.
"""

import numpy as np

from common.robot.rotations import (
    clamp_norm,
    matrix_from_rotation_vector,
    rotation_vector_from_matrix,
)
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import HandConfig


def _gain(innovation: float, speed: float, config: HandConfig) -> float:
    """Return the filter gain: ``tremor_gain`` rising smoothly to 1 at ``movement_ratio``.

    Args:
        innovation: distance from the prediction in units of the largest tremor.
        speed: in units of the slowest movement.
        config: of the hands.
    """
    share = (max(innovation, speed) - 1.0) / (config.movement_ratio - 1.0)
    share = min(max(share, 0.0), 1.0)
    return config.tremor_gain + (1.0 - config.tremor_gain) * share * share * (3.0 - 2.0 * share)


def _norm(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))


class OperatorMotion:
    """Estimates one hand's motion from set-points; pure.

    Attributes:
        position: (3,) in the frame of the set-points [m].
        rotation: (3, 3) hand to that frame.
        rate: (6,) linear and angular velocity, limited [m/s, rad/s].
    """

    def __init__(self, config: HandConfig, position: Array, rotation: Array) -> None:
        """Start at rest at a pose."""
        self._config = config
        self.position, self.rotation, self.rate = position, rotation, np.zeros(6)

    def update(self, position: Array, rotation: Array, elapsed: float) -> None:
        """Include a set-point (3,), (3, 3) that came ``elapsed`` [s] after the previous one."""
        config = self._config
        expected = self.position + self.rate[:3] * elapsed
        turned = matrix_from_rotation_vector(self.rate[3:] * elapsed).dot(self.rotation)
        shift, turn = position - expected, rotation_vector_from_matrix(rotation.dot(turned.T))
        gain = _gain(
            _norm(shift) / config.tremor, _norm(self.rate[:3]) / config.movement_speed, config
        )
        turn_gain = _gain(
            _norm(turn) / config.tremor_angle, _norm(self.rate[3:]) / config.movement_rate, config
        )
        self.position = expected + gain * shift
        self.rotation = matrix_from_rotation_vector(turn_gain * turn).dot(turned)
        self.rate = np.concatenate(
            (
                clamp_norm(
                    self.rate[:3] + _rate_gain(gain) / elapsed * shift,
                    config.feedforward_speed_max,
                ),
                clamp_norm(
                    self.rate[3:] + _rate_gain(turn_gain) / elapsed * turn,
                    config.feedforward_rate_max,
                ),
            )
        )


def _rate_gain(gain: float) -> float:
    """Return beta for alpha; with 1 the velocity is that between the last two set-points."""
    return gain * gain / (2.0 - gain)
