"""Looks never collide, collision shapes are named, and the robot does not fight itself."""

from typing import Any

import mujoco
import numpy as np
import pytest

from common.robot import frames, joints

from .support import set_joints

VISUAL, COLLISION = 2, 3


def _touching(model: Any, data: Any) -> set[frozenset[str]]:
    mujoco.mj_forward(model, data)
    return {
        frozenset(model.geom(int(g)).name for g in contact.geom)
        for contact in data.contact[: data.ncon]
    }


def test_every_geom_is_either_looks_or_a_named_collision_shape(mj_model: Any) -> None:
    counts = {VISUAL: 0, COLLISION: 0}
    for i in range(mj_model.ngeom):
        geom = mj_model.geom(i)
        collides = bool(geom.contype[0] or geom.conaffinity[0])
        assert collides == (geom.group[0] == COLLISION)
        assert geom.name.endswith(frames.COLLISION_SUFFIX) == collides
        counts[int(geom.group[0])] += 1
    assert counts[COLLISION] >= 28
    assert counts[VISUAL] > 100


def test_collision_shapes_cover_the_limbs(mj_model: Any) -> None:
    parts = ["foot", "shank_up", "shank_low", "thigh", "hip_motor", "shoulder", "upper_arm"]
    parts += ["elbow_motor", "forearm", "wrist", "palm", "finger_a", "finger_b"]
    sided = [f"{side}_{part}_col" for side in "lr" for part in parts]
    for name in ["pelvis_col", "chest_col", "yoke_col", "head_col", *sided]:
        assert mj_model.geom(name).contype[0] == 1


def test_foot_box_is_the_one_the_walking_gains_were_found_on(mj_model: Any) -> None:
    for name in frames.FOOT_GEOMS.values():
        foot = mj_model.geom(name)
        assert tuple(foot.size) == frames.FOOT_COLLISION_HALF_SIZE
        assert foot.friction[0] == 1.0
        assert tuple(foot.solref) == (0.004, 1.0)
        assert tuple(foot.solimp[:3]) == (0.95, 0.99, 0.001)
        assert (foot.priority[0], foot.condim[0]) == (1, 3)
        assert foot.pos[2] - foot.size[2] == pytest.approx(-0.0755)
    for name in (n for pair in frames.FINGER_GEOMS.values() for n in pair):
        pad = mj_model.geom(name)
        assert (pad.friction[0], pad.condim[0], pad.priority[0]) == (1.5, 4, 2)


@pytest.mark.parametrize("opening", [0.0, joints.GRIPPER_STROKE])
def test_nominal_pose_has_no_self_contact(mj_model: Any, nominal: Any, opening: float) -> None:
    fingers = {f: opening for pair in joints.FINGER_JOINTS.values() for f in pair}
    set_joints(mj_model, nominal, fingers)
    assert _touching(mj_model, nominal) == set()


def test_walking_range_of_the_legs_has_no_self_contact(mj_model: Any, nominal: Any) -> None:
    """From straight to deeply crouched legs, either foot ahead: the shells clear each other."""
    for bend in np.linspace(0.1, 1.1, 6):
        for swing in (-0.3, 0.0, 0.3):
            for side, sign in (("l", 1.0), ("r", -1.0)):
                pose = {"hip_fe": -bend + sign * swing, "knee_fe_jp": bend, "knee_fe_jd": bend}
                pose["ankle_fe"] = -bend - sign * swing
                set_joints(mj_model, nominal, {f"{side}_{k}": v for k, v in pose.items()})
            assert _touching(mj_model, nominal) == set(), (bend, swing)


def test_feet_collide_with_each_other(mj_model: Any, nominal: Any) -> None:
    set_joints(mj_model, nominal, {"l_hip_aa": -0.1, "r_hip_aa": 0.1})
    assert frozenset(frames.FOOT_GEOMS.values()) in _touching(mj_model, nominal)


def test_a_hand_pressed_into_the_body_is_seen(mj_model: Any, nominal: Any) -> None:
    set_joints(mj_model, nominal, {"l_shoulder_ie": -1.2})
    assert frozenset({"pelvis_col", "l_palm_col"}) in _touching(mj_model, nominal)


def test_looks_stay_close_to_the_collision_shape_of_the_sole(mj_model: Any, nominal: Any) -> None:
    """What the operator sees of a foot ends where it really touches."""
    for side in "lr":
        ankle = mj_model.body(f"{side}_ankle_ie_link").id
        geoms = [i for i in range(mj_model.ngeom) if mj_model.geom_bodyid[i] == ankle]
        soles = [i for i in geoms if mj_model.geom_group[i] == VISUAL]
        lowest = min(_lowest(mj_model, nominal, i) for i in soles)
        box = mj_model.geom(f"{side}_foot_col").id
        bottom = nominal.geom_xpos[box][2] - mj_model.geom_size[box][2]
        assert lowest == pytest.approx(bottom, abs=2e-3)


def _lowest(model: Any, data: Any, geom: int) -> float:
    """Lowest world z of a geom: mesh vertices, or the centre of any other shape."""
    if model.geom_type[geom] != mujoco.mjtGeom.mjGEOM_MESH:
        return float(data.geom_xpos[geom][2])
    mesh = model.geom_dataid[geom]
    start, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    vertices = model.mesh_vert[start : start + count]
    rotation = data.geom_xmat[geom].reshape(3, 3)
    return float((vertices @ rotation.T + data.geom_xpos[geom])[:, 2].min())
