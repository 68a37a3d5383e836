"""Configuration: what is refused, what the modes and paces mean."""

import numpy as np
import pytest
from pydantic import ValidationError

from common.robot import joints
from services.wbc.config import PACES, GaitConfig, HandConfig, WbcConfig, wbc_config
from services.wbc.errors import SolverUnavailableError
from services.wbc.gains import Gains, MotorGains
from services.wbc.solvers import make_solver


@pytest.mark.parametrize(
    "table",
    [
        {"rates": 100.0},
        {"gait": {"step_lenght": 0.2}},
        {"hands": {"mode": "interpolate", "speed": 1.0}},
        {"tasks": {"foot": {"kp": 300.0, "kd": 30.0, "ki": 1.0}}},
        {"solver": "mosek"},
        {"rate": 10.0},
        {"rate": float("nan")},
        {"gait": {"com_height": 0.75}},
        {"gait": {"com_height": 0.5}},
        {"contact": {"friction": 0.0}},
        {"limits": {"torque_mode": "unlimited"}},
        {"tasks": {"foot": {"kp": -1.0, "kd": 30.0}}},
    ],
)
def test_wrong_tables_are_refused(table: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        WbcConfig.model_validate(table)


def test_a_configuration_cannot_change() -> None:
    with pytest.raises(ValidationError, match="frozen"):
        WbcConfig().rate = 200.0


@pytest.mark.parametrize(
    ("pace", "seconds"), [("fast", 2.2), ("normal", 3.35), ("slow", 3.95), ("public", 6.1)]
)
def test_paces(pace: str, seconds: float) -> None:
    assert GaitConfig(**PACES[pace]).duration == pytest.approx(seconds, abs=1e-9)
    assert wbc_config(pace=pace).gait.duration == pytest.approx(seconds, abs=1e-9)
    assert set(PACES) == {"fast", "normal", "slow", "public"}


def test_modes() -> None:
    relaxed, rated = wbc_config(), wbc_config("rated")
    assert relaxed == WbcConfig()
    assert relaxed.limits.torque_mode == "relaxed"
    assert relaxed.gait.com_height == 0.70
    assert rated.limits.torque_mode == "rated"
    assert rated.gait.com_height == 0.73
    assert rated.gait.duration == pytest.approx(3.95)
    assert wbc_config("rated", "fast").gait.duration == pytest.approx(2.2)


def test_overrides_reach_the_top_level() -> None:
    config = wbc_config("rated", solver="daqp", hands=HandConfig(mode="raw"))
    assert config.solver == "daqp"
    assert config.hands.mode == "raw"
    assert config.limits.torque_mode == "rated"
    with pytest.raises(ValueError, match="solvr"):
        wbc_config(solvr="daqp")


def test_unknown_pace_is_refused() -> None:
    with pytest.raises(ValueError, match=r"unknown pace 'brisk', expected one of \['fast'"):
        wbc_config(pace="brisk")


def test_unknown_solver_is_refused() -> None:
    with pytest.raises(SolverUnavailableError, match="unknown solver 'mosek'"):
        make_solver("mosek")


def test_motor_gains_reach_their_joints() -> None:
    """A knee's gain is for the coordinate: both hinges together give it."""
    table = {
        name: Gains(kp=10.0 * k, kd=1.0 * k)
        for k, name in enumerate(MotorGains.model_fields, start=1)
    }
    stiffness, damping = MotorGains(**table).per_joint()
    expected = {
        "hip_ie": 10.0, "hip_aa": 10.0, "hip_fe": 10.0,
        "knee_fe_jp": 10.0, "knee_fe_jd": 10.0,
        "ankle_fe": 30.0, "ankle_ie": 30.0,
        "shoulder_fe": 40.0, "shoulder_aa": 40.0, "shoulder_ie": 40.0, "elbow_fe": 50.0,
        "wrist_ps": 60.0, "wrist_pitch": 60.0,
    }  # fmt: skip
    for index, name in enumerate(joints.JOINT_NAMES):
        kp = 70.0 if name == "neck_pitch" else expected[name[2:]]
        assert stiffness[index] == kp
        assert damping[index] == pytest.approx(0.1 * kp)
    coordinate = joints.MOTOR_TO_JOINT.T @ stiffness
    assert coordinate[joints.MOTOR_NAMES.index("l_knee")] == table["knee"].kp
    assert np.isfinite(stiffness).all()
