"""The robot as both libraries read it."""

from typing import Any

import mujoco
import pinocchio as pin
import pytest

from common.robot import joints

from .support import set_joints


@pytest.fixture(scope="session")
def mj_model() -> Any:
    return mujoco.MjModel.from_xml_path(str(joints.MJCF_PATH))


@pytest.fixture(scope="session")
def pin_model() -> Any:
    return pin.buildModelFromMJCF(str(joints.MJCF_PATH))


@pytest.fixture
def nominal(mj_model: Any) -> Any:
    """MuJoCo data at the nominal crouch, fingers closed, kinematics and contacts computed."""
    data = mujoco.MjData(mj_model)
    set_joints(mj_model, data, dict(zip(joints.JOINT_NAMES, joints.NOMINAL_POSITION, strict=True)))
    data.qpos[2] = joints.NOMINAL_BASE_HEIGHT
    mujoco.mj_forward(mj_model, data)
    return data
