"""Where the operator's hand is and how fast, out of set-points that tremble.

An alpha-beta filter whose gain depends on how far the set-point is from where it was predicted and
on how fast the hand is: trembling is mostly averaged away, a movement is taken as it comes. The
gains of position and velocity go together as in T. R. Benedict and G. W. Bordner, "Synthesis of an
optimal set of radar track-while-scan smoothing equations", IRE Trans. Automatic Control 7 (1962),
so that steady motion is followed without lag.
"""

import numpy as np

from common.robot.rotations import (
    clamp_norm,
    matrix_from_rotation_vector,
    rotation_vector_from_matrix,
)
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import HandConfig


def _gain(surprise: float, speed: float, config: HandConfig) -> float:
    """From ``tremor_gain``, where both are at most 1, smoothly to 1 at ``movement_ratio``.

    Args:
        surprise: distance from where it was predicted, in units of the largest tremor.
        speed: in units of the slowest movement.
        config: of the hands.
    """
    share = (max(surprise, speed) - 1.0) / (config.movement_ratio - 1.0)
    share = min(max(share, 0.0), 1.0)
    return config.tremor_gain + (1.0 - config.tremor_gain) * share * share * (3.0 - 2.0 * share)


def _norm(vector: Array) -> float:
    return float(np.sqrt(vector @ vector))


class OperatorMotion:
    """One hand's motion, from set-point to set-point; pure.

    Attributes:
        position: (3,) of the hand, in the frame of the set-points [m].
        rotation: (3, 3).
        rate: (6,) linear [m/s] and angular [rad/s] velocity, capped.
    """

    def __init__(self, config: HandConfig, position: Array, rotation: Array) -> None:
        """At rest."""
        self._config = config
        self.position, self.rotation, self.rate = position, rotation, np.zeros(6)

    def take(self, position: Array, rotation: Array, elapsed: float) -> None:
        """Take in a set-point (3,), (3, 3), ``elapsed`` [s] after the one before."""
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
    """Beta of alpha; 1 at 1: the velocity is then that between the last two set-points."""
    return gain * gain / (2.0 - gain)
