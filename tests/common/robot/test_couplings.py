"""The rolling knee and the parallel jaw in motion."""

from typing import Any

import mujoco
import numpy as np
import pytest

from common.robot import joints

TIMESTEP = 0.001


@pytest.fixture
def plant() -> Any:
    """Robot in free fall (no floor), with the plant's integrator."""
    spec = mujoco.MjSpec.from_file(str(joints.MJCF_PATH))
    spec.option.timestep = TIMESTEP
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    return spec.compile()


def _start(model: Any) -> Any:
    data = mujoco.MjData(model)
    for name, value in zip(joints.JOINT_NAMES, joints.NOMINAL_POSITION, strict=True):
        data.qpos[model.joint(name).qposadr[0]] = value
    mujoco.mj_forward(model, data)
    return data


def test_knee_motor_turns_both_hinges_with_its_own_torque(plant: Any) -> None:
    data = _start(plant)
    data.actuator("l_knee").ctrl[:] = 25.0
    mujoco.mj_forward(plant, data)
    jp, jd = (data.joint(name).qfrc_actuator[0] for name in joints.KNEE_JOINTS[0])
    assert (jp, jd) == (25.0, 25.0)
    assert data.actuator("l_knee").velocity[0] == 0.0
    assert np.count_nonzero(data.qfrc_actuator) == 2


def test_knee_halves_stay_equal_in_a_violent_swing(plant: Any) -> None:
    """One second of free fall while the motors swing both knees through about 75 degrees of q."""
    data = _start(plant)
    pairs = [[data.joint(name) for name in pair] for pair in joints.KNEE_JOINTS]
    worst, low, high = 0.0, np.inf, -np.inf
    for step in range(round(1.0 / TIMESTEP)):
        for name, (_, jd), sign in zip(("l_knee", "r_knee"), pairs, (1, -1), strict=True):
            target = 0.75 + sign * 0.6 * np.sin(2 * np.pi * step * TIMESTEP / 0.5)
            torque = 150.0 * (target - jd.qpos[0]) - 4.0 * jd.qvel[0]
            data.actuator(name).ctrl[:] = np.clip(torque, -40.85, 40.85)
        mujoco.mj_step(plant, data)
        for jp, jd in pairs:
            worst = max(worst, abs(jp.qpos[0] - jd.qpos[0]))
            low, high = min(low, jd.qpos[0]), max(high, jd.qpos[0])
    assert high - low > np.deg2rad(60)
    assert np.rad2deg(worst) < 0.02


@pytest.mark.parametrize("side", ["left", "right"])
def test_gripper_opens_closes_and_squeezes(plant: Any, side: str) -> None:
    data = _start(plant)
    a, b = (data.joint(name) for name in joints.FINGER_JOINTS[side])
    gripper = data.actuator(joints.GRIPPER_ACTUATORS[side])
    gripper.ctrl[:] = joints.GRIPPER_OPEN_COMMAND
    for _ in range(500):
        mujoco.mj_step(plant, data)
    assert a.qpos[0] == pytest.approx(joints.GRIPPER_STROKE, abs=2e-4)
    assert b.qpos[0] == pytest.approx(a.qpos[0], abs=1e-4)
    gripper.ctrl[:] = joints.GRIPPER_CLOSE_COMMAND
    for _ in range(500):
        mujoco.mj_step(plant, data)
    assert a.qpos[0] == pytest.approx(0.0, abs=1e-3)
    assert b.qpos[0] == pytest.approx(a.qpos[0], abs=1e-4)
    assert gripper.force[0] == pytest.approx(-joints.GRIPPER_FORCE, rel=0.06)


def test_equalities_and_tendons_are_those_documented(plant: Any) -> None:
    for side, (jp, jd) in zip("lr", joints.KNEE_JOINTS, strict=True):
        equality = plant.equality(f"{side}_knee")
        assert plant.joint(int(equality.obj1id[0])).name == jd
        assert plant.joint(int(equality.obj2id[0])).name == jp
        assert tuple(equality.data[:5]) == (0.0, 1.0, 0.0, 0.0, 0.0)
        assert tuple(equality.solref) == (0.004, 1.0)
        tendon = plant.tendon(f"{side}_knee").id
        start, count = plant.tendon_adr[tendon], plant.tendon_num[tendon]
        wrapped = [plant.joint(int(i)).name for i in plant.wrap_objid[start : start + count]]
        assert wrapped == [jp, jd]
        assert tuple(plant.wrap_prm[start : start + count]) == (1.0, 1.0)
    for fingers in joints.FINGER_JOINTS.values():
        assert plant.equality(f"{fingers[0][0]}_fingers").type[0] == mujoco.mjtEq.mjEQ_JOINT
