"""The motor servo, in numbers worked out by hand."""

from typing import Any

import numpy as np
import pytest

from common.plant import servo as module
from common.plant.config import TorqueMode
from common.plant.servo import JOINT_TO_MOTOR, Servo, motor_target
from common.robot.joints import JOINT_INDEX, MOTOR_NAMES
from tests.services.sim.support import MS

STAMP = 2000 * MS
HIP, KNEE = MOTOR_NAMES.index("l_hip_fe"), MOTOR_NAMES.index("l_knee")
ELBOW, ANKLE = MOTOR_NAMES.index("r_elbow_fe"), MOTOR_NAMES.index("l_ankle_fe")


def joints(**values: float) -> Any:
    vector = np.zeros(27)
    for name, value in values.items():
        vector[JOINT_INDEX[name]] = value
    return vector


def target(**changes: Any) -> Any:
    zero = np.zeros(27)
    names = ("position", "velocity", "acceleration", "torque", "stiffness", "damping")
    return motor_target(STAMP, **(dict.fromkeys(names, zero) | changes))


def torque(servo: Servo, what: Any, now_ns: int) -> Any:
    out = np.zeros(25)
    servo.torque(what, now_ns, out)
    return out


@pytest.fixture
def servo() -> Servo:
    return Servo(TorqueMode.RELAXED)


@pytest.mark.parametrize(
    ("age_ms", "expected"),
    [
        # tau = 5 + 40 (0.1 + 2 h + 5 h² - 0.3) + 3 (2 + 10 h - 1)
        (0, 0.0),
        (10, 5 + 40 * (0.1 + 0.02 + 0.0005 - 0.3) + 3 * (2 + 0.1 - 1)),
        (30, 5 + 40 * (0.1 + 0.06 + 0.0045 - 0.3) + 3 * (2 + 0.3 - 1)),
        (80, 5 + 40 * (0.1 + 0.06 + 0.0045 - 0.3) + 3 * (2 + 0.3 - 1)),
        (-20, 0.0),
    ],
)
def test_set_points_are_extrapolated_for_30_ms(servo: Servo, age_ms: int, expected: float) -> None:
    what = target(
        position=joints(l_hip_fe=0.1),
        velocity=joints(l_hip_fe=2.0),
        acceleration=joints(l_hip_fe=10.0),
        torque=joints(l_hip_fe=5.0),
        stiffness=joints(l_hip_fe=40.0),
        damping=joints(l_hip_fe=3.0),
    )
    servo.position[HIP], servo.velocity[HIP] = 0.3, 1.0
    assert torque(servo, what, STAMP + age_ms * MS)[HIP] == pytest.approx(expected, abs=1e-12)


def test_the_knee_is_one_motor_on_the_mean_of_its_halves(servo: Servo) -> None:
    what = target(
        position=joints(l_knee_fe_jp=0.5, l_knee_fe_jd=0.7),
        torque=joints(l_knee_fe_jp=10.0, l_knee_fe_jd=30.0),
        stiffness=joints(l_knee_fe_jp=100.0, l_knee_fe_jd=200.0),
        damping=joints(l_knee_fe_jp=4.0, l_knee_fe_jd=4.0),
    )
    servo.position[:] = JOINT_TO_MOTOR @ joints(l_knee_fe_jp=0.38, l_knee_fe_jd=0.42)
    servo.velocity[KNEE] = 0.5
    halves = (10 + 100 * (0.5 - 0.4) - 4 * 0.5, 30 + 200 * (0.7 - 0.4) - 4 * 0.5)
    assert torque(servo, what, STAMP)[KNEE] == pytest.approx(sum(halves) / 2, abs=1e-12)


@pytest.mark.parametrize(
    ("mode", "knee", "ankle", "elbow"),
    [(TorqueMode.RELAXED, 240.85, 244.0, 10.0), (TorqueMode.RATED, 40.85, 44.0, 10.0)],
)
def test_torques_are_cut_at_the_limit_and_counted(
    mode: TorqueMode, knee: float, ankle: float, elbow: float
) -> None:
    servo = Servo(mode)
    servo.position[ELBOW] = -1.0
    servo.position[ANKLE] = -0.2
    what = target(
        torque=joints(l_knee_fe_jp=481.0, l_knee_fe_jd=481.0, l_ankle_fe=-480.0, r_elbow_fe=-20.0)
    )
    out = torque(servo, what, STAMP)
    assert out[[KNEE, ANKLE, ELBOW]] == pytest.approx([knee, -ankle, -elbow])
    assert servo.saturated_steps == 1
    torque(servo, target(torque=joints(l_ankle_fe=40.0)), STAMP)
    assert servo.saturated_steps == 1


@pytest.mark.parametrize(
    ("position", "wanted", "given"),
    [
        (1.0472, 100.0, 100.0),
        (1.0572, 100.0, 50.0),
        (1.0672, 100.0, 0.0),
        (1.5, 100.0, 0.0),
        (1.5, -100.0, -100.0),
        (-1.5808, -100.0, -50.0),
        (-1.5808, 100.0, 100.0),
    ],
)
def test_torque_into_a_stop_fades_out(
    servo: Servo, position: float, wanted: float, given: float
) -> None:
    servo.position[ANKLE] = position
    out = torque(servo, target(torque=joints(l_ankle_fe=wanted)), STAMP)
    assert out[ANKLE] == pytest.approx(given, abs=1e-9)
    assert servo.saturated_steps == 0


@pytest.mark.skipif(module._servo is None, reason="the kernel is not built")
def test_the_compiled_law_is_that_of_python(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(3)
    for _ in range(50):
        parts = 100.0 * rng.normal(size=(6, 27)) * rng.integers(0, 2, (6, 27))
        compiled = motor_target(STAMP, *parts)
        with monkeypatch.context() as patch:
            patch.setattr(module, "_servo", None)
            assert motor_target(STAMP, *parts).law.tobytes() == compiled.law.tobytes()
