"""Sensor noise has the configured size, and none by default."""

import numpy as np
import pytest

from services.sim.config import TYPICAL_NOISE, SimConfig
from services.sim.physics.plant import Plant

from .support import state_bytes


def test_no_noise_by_default() -> None:
    plant = Plant()
    assert state_bytes(plant.measured()) == state_bytes(plant.truth())


def test_standard_deviations() -> None:
    plant = Plant(SimConfig(noise=TYPICAL_NOISE, start_yaw_spread=1.0, seed=4))
    truth = plant.truth()
    samples = [plant.measured() for _ in range(1500)]

    def deviation(name: str) -> float:
        errors = np.array([getattr(s, name) - getattr(truth, name) for s in samples])
        assert np.abs(errors.mean(axis=0)).max() < 0.15 * errors.std(), "unbiased"
        return float(errors.std())

    assert deviation("base_position") == pytest.approx(0.002, rel=0.1)
    assert deviation("base_linear_velocity") == pytest.approx(0.02, rel=0.1)
    assert deviation("base_angular_velocity") == pytest.approx(0.02, rel=0.1)
    assert deviation("joint_position") == pytest.approx(1e-4, rel=0.05)
    assert deviation("joint_velocity") == pytest.approx(0.05, rel=0.05)
    quaternions = np.array([s.base_quaternion for s in samples])
    assert np.linalg.norm(quaternions, axis=1) == pytest.approx(np.ones(1500), abs=1e-12)
    # |rotation error| of three axes: sqrt(3) sigma in the root mean square.
    angles = 2.0 * np.arccos(np.clip(np.abs(quaternions @ truth.base_quaternion), 0.0, 1.0))
    assert np.sqrt((angles**2).mean()) == pytest.approx(np.sqrt(3.0) * 0.0052, rel=0.1)
    for name in ("joint_torque", "foot_normal_force", "gripper_closure"):
        assert np.array_equal(getattr(samples[0], name), getattr(truth, name))
