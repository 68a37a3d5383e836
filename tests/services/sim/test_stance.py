"""The initial pose."""

from typing import Any

import mujoco
import numpy as np
import pytest

from common.robot.joints import JOINT_INDEX
from services.sim.errors import SceneError, StandError
from services.sim.model.robot_state import jaw_closure, jaw_command
from services.sim.model.world import build_model, build_spec, find_addresses
from services.sim.physics.stance import standing_qpos, standing_torque


@pytest.fixture(scope="module")
def model() -> Any:
    return build_model()


@pytest.mark.parametrize(("com_height", "width"), [(0.6, 0.28), (0.7, 0.24), (0.75, 0.32)])
def test_feet_flat_com_above_them_at_the_height_asked_for(
    model: Any, com_height: float, width: float
) -> None:
    addresses = find_addresses(model)
    data = mujoco.MjData(model)
    data.qpos[:] = standing_qpos(model, addresses, com_height, width)
    mujoco.mj_forward(model, data)
    left, right = data.site("l_foot"), data.site("r_foot")
    for foot in (left, right):
        assert foot.xmat.reshape(3, 3) == pytest.approx(np.eye(3), abs=1e-9)
    assert left.xpos[1] - right.xpos[1] == pytest.approx(width, abs=1e-5)
    com = data.subtree_com[addresses.torso]
    middle = 0.5 * (left.xpos + right.xpos)
    assert com[2] - middle[2] == pytest.approx(com_height, abs=1e-5)
    assert com[0] == pytest.approx(middle[0], abs=1e-5)
    assert abs(com[1] - middle[1]) < 0.003
    assert data.qpos[3:7] == pytest.approx([1, 0, 0, 0])
    soles = [data.geom_xpos[foot][2] - 0.0295 for foot in addresses.feet]
    assert min(soles) == pytest.approx(0.0, abs=1e-9)


def test_torques_are_those_of_statics(model: Any) -> None:
    addresses = find_addresses(model)
    torque = standing_torque(model, addresses, standing_qpos(model, addresses, 0.7, 0.28))
    # Public measurement: 42.5 to 48 N·m on the knee coordinate at this height, on two halves.
    for side in "lr":
        jp, jd = (torque[JOINT_INDEX[f"{side}_knee_fe_{half}"]] for half in ("jp", "jd"))
        assert jp == jd
        assert -26.0 < jp < -19.0
        assert abs(torque[JOINT_INDEX[f"{side}_ankle_fe"]]) < 1.0, "the CoM is over the ankles"


def test_a_giant_stance_is_refused_with_the_reason(model: Any) -> None:
    with pytest.raises(StandError, match=r"CoM 0\.9 m above the soles.*expected"):
        standing_qpos(model, find_addresses(model), 0.9, 0.28)


def test_looks_do_not_matter_to_physics(model: Any) -> None:
    bare = build_model(visuals=False)
    assert bare.ngeom < 40 < model.ngeom
    states = []
    for each in (model, bare):
        data = mujoco.MjData(each)
        data.qpos[:] = standing_qpos(each, find_addresses(each), 0.7, 0.28)
        mujoco.mj_step(each, data, 300)
        states.append(np.array(data.qpos))
    assert np.array_equal(states[0], states[1])


def test_motors_out_of_order_are_refused() -> None:
    spec = build_spec(visuals=False)
    spec.delete(spec.actuators[0])
    with pytest.raises(
        SceneError, match="expected the model's first 25 actuators to be the motors"
    ):
        find_addresses(spec.compile())


def test_an_unknown_scene_is_refused_with_the_known_ones() -> None:
    with pytest.raises(SceneError, match=r"unknown scene 'moon': expected one of .*'door', 'flat'"):
        build_model("moon")


def test_closure_and_jaw_agree() -> None:
    closures = [0.0, 0.25, 0.5, 0.9]
    commands = [jaw_command(closure) for closure in closures]
    assert commands == pytest.approx([0.045, 0.03375, 0.0225, 0.0045])
    assert [jaw_closure(finger) for finger in commands] == pytest.approx(closures)
    assert [jaw_command(closure) for closure in (1.0, 1.5, -1.0)] == pytest.approx([-0.02, -0.02, 0.045])
    assert [jaw_closure(finger) for finger in (-0.001, 0.046)] == [1.0, 0.0]
