"""The kernel that fills the QP, against the Python code that says what is right."""

import numpy as np
import pytest

from common.native import kernel
from common.robot.rotations import matrix_from_rotation_vector
from services.wbc.config import TaskConfig, WbcConfig
from services.wbc.qp import AIRBORNE, INFINITY, QpBuilder, QpData
from services.wbc.robot_model import Dynamics, RobotModel, RobotState
from services.wbc.tasks import NUM_ROWS, TaskStack

from .support import Array, copy_qp, random_states

pytestmark = pytest.mark.skipif(
    kernel("services.wbc._qp") is None,
    reason="the kernel is not built; python hatch_build.py builds it",
)
CONTACTS = ((1000.0, AIRBORNE), (0.001, 500.0), (400.0, 300.0))


HALF_TURNS = (0.7, 0.0, 1.0 - 1e-5, 1e-6)
"""Errors of the rotations, in half turns: both ends need a care of their own."""


def _turned(dynamics: Dynamics, rng: np.random.Generator, half_turns: float) -> list[Array]:
    """Rotations of torso, hands and feet that are off by an angle about any axis."""
    axes = rng.normal(size=(5, 3))
    axes *= np.pi * half_turns / np.linalg.norm(axes, axis=1)[:, None]
    found = (dynamics.base_rotation, *dynamics.frame_rotations)
    return [matrix_from_rotation_vector(a) @ r for a, r in zip(axes, found, strict=True)]


def _built(model: RobotModel) -> list[tuple[QpData, Array]]:
    """Random tasks at random states, feet in turn in the air, in the same arrays."""
    rng = np.random.default_rng(6)
    builder, stack = QpBuilder(WbcConfig()), TaskStack(TaskConfig())
    built = []
    for index, state in enumerate(random_states(12, seed=8)):
        for field in (stack.position, stack.velocity, stack.acceleration):
            field[:] = rng.normal(size=NUM_ROWS)
        stack.weight[:] = rng.uniform(0.1, 60.0, NUM_ROWS)
        dynamics = model.update(RobotState.from_plant(state))
        stack.rotation[:] = _turned(dynamics, rng, HALF_TURNS[index % 4])
        stack.finish(dynamics)
        data = builder.build(dynamics, stack, CONTACTS[index % 3], (150.0, 200.0))
        built.append((copy_qp(data), stack.error.copy()))
    return built


def test_it_fills_what_python_fills(model: RobotModel, monkeypatch: pytest.MonkeyPatch) -> None:
    compiled = _built(model)
    monkeypatch.setenv("TRILL_NATIVE", "0")
    for (ours, error), (reference, wanted) in zip(compiled, _built(model), strict=True):
        assert np.abs(error - wanted).max() < 1e-9
        for name in "PqAlu":
            expected = getattr(reference, name)
            # Bounds that are none are 1e20.
            scale = np.abs(expected)[np.abs(expected) < INFINITY].max(initial=1.0)
            assert np.abs(getattr(ours, name) - expected).max() < 1e-13 * scale, name
        assert np.array_equal(ours.P, ours.P.T)
