"""Trembling is left out of hand references, movements are not."""

from collections.abc import Callable

import numpy as np
import pytest

from common.robot.rotations import matrix_from_rotation_vector
from services.wbc.config import HandConfig
from services.wbc.operator_motion import OperatorMotion

from .hand_motion import AHEAD, CONFIG, HOME, PERIOD, Pose, at_x, follow, resting_hand


def _trembling(seed: int) -> Callable[[float], Pose]:
    """0.8 mm and 0.006 rad an axis, 0.8 to 9 Hz."""
    rng = np.random.default_rng(seed)
    rates = 2.0 * np.pi * np.exp(rng.uniform(np.log(0.8), np.log(9.0), (6, 8)))
    phases = rng.uniform(0.0, 2.0 * np.pi, (6, 8))

    def pose(time: float) -> Pose:
        tones = 0.5 * np.sin(rates * time + phases).sum(axis=1)
        return HOME + 0.0008 * tones[:3], matrix_from_rotation_vector(0.006 * tones[3:])

    return pose


def _shaken(config: HandConfig) -> tuple[float, float]:
    """Root mean square of linear and angular acceleration under tremor [m/s², rad/s²]."""
    squares = [
        (
            float(r.acceleration[:3] @ r.acceleration[:3]),
            float(r.acceleration[3:] @ r.acceleration[3:]),
        )
        for seed in range(4)
        for t, r in follow(resting_hand(config=config), _trembling(seed), 6.0)
        if t > 1.0
    ]
    linear, angular = np.sqrt(np.mean(squares, axis=0))
    return float(linear), float(angular)


def test_trembling_is_mostly_left_out() -> None:
    linear, angular = _shaken(CONFIG)
    whole_linear, whole_angular = _shaken(HandConfig(tremor_gain=1.0))
    assert linear < 0.25 * whole_linear
    assert angular < 0.25 * whole_angular
    # And the pose stays that of the steady hand.
    track = [r for t, r in follow(resting_hand(), _trembling(7), 6.0) if t > 1.0]
    assert max(np.linalg.norm(r.position - HOME) for r in track) < 0.003


def test_a_movement_is_taken_as_it_comes() -> None:
    motion = OperatorMotion(CONFIG, HOME, AHEAD)
    step = np.array([CONFIG.movement_ratio * CONFIG.tremor, 0.0, 0.0])
    turned = matrix_from_rotation_vector(np.array([0.0, 0.0, 0.1]))
    motion.update(HOME + step, turned, PERIOD)
    assert motion.position == pytest.approx(HOME + step, abs=1e-15)
    assert motion.rate[:3] == pytest.approx(step / PERIOD)
    assert motion.rate[3:] == pytest.approx([0.0, 0.0, 0.1 / PERIOD])
    assert np.abs(motion.rotation - turned).max() < 1e-15


@pytest.mark.parametrize("speed", [0.005, 0.02, 0.05])
def test_slow_motion_is_followed_without_lasting_lag(speed: float) -> None:
    track = follow(resting_hand(), lambda t: at_x(0.3 + speed * t), 4.0)
    errors = [abs(r.position[0] - 0.3 - speed * t) for t, r in track]
    assert max(errors) < 0.005
    assert max(errors[-100:]) < 2e-4
