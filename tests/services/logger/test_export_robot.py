"""Links and shapes of the exported robot against MuJoCo's own kinematics."""

from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from common.robot.frames import BODY_FRAME, HAND_FRAMES
from common.robot.joints import FINGER_JOINTS, GRIPPER_STROKE, JOINT_NAMES, MJCF_PATH
from services.logger.export.convert import export_log
from services.logger.export.meshes import box, turned
from services.logger.export.robot import RobotModel
from tests.services.logger.export_support import plant, read, sample, write


def matrix(w: float, x: float, y: float, z: float) -> Any:
    result = np.zeros(9)
    mujoco.mju_quat2Mat(result, np.array([w, x, y, z]))
    return result.reshape(3, 3)


def reference(seed: int) -> Any:
    """MuJoCo's data with the whole robot, base and all, posed at once."""
    state = plant(seed)
    model = mujoco.MjModel.from_xml_path(str(MJCF_PATH))
    data = mujoco.MjData(model)
    data.joint("base").qpos[:] = [*state.base_position, *state.base_quaternion]
    for name, value in zip(JOINT_NAMES, state.joint_position, strict=True):
        data.joint(name).qpos[0] = value
    for side, closure in zip(("left", "right"), state.gripper_closure, strict=True):
        for name in FINGER_JOINTS[side]:
            data.joint(name).qpos[0] = GRIPPER_STROKE * (1.0 - closure)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    return model, data


def test_transforms_chain_to_where_every_link_is(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [sample("plant/state", plant(5), 0)])
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    found = read(tmp_path / "out.mcap")
    (tf,) = found["/tf"]
    placed = {"world": (np.eye(3), np.zeros(3))}
    for one in tf.message.transforms:
        turn, place = placed[one.parent_frame_id]
        r, t = one.rotation, one.translation
        placed[one.child_frame_id] = (
            turn @ matrix(r.w, r.x, r.y, r.z),
            place + turn @ np.array([t.x, t.y, t.z]),
        )
    model, data = reference(5)
    bodies = [model.body(i).name for i in range(1, model.nbody)]
    for name in bodies:
        assert np.allclose(placed[name][1], data.body(name).xpos, atol=1e-9)
        assert np.allclose(placed[name][0], data.body(name).xmat.reshape(3, 3), atol=1e-9)
    for name in ("l_hand", "r_hand", "l_foot", "r_foot"):
        assert np.allclose(placed[name][1], data.site(name).xpos, atol=1e-9)
        assert np.allclose(placed[name][0], data.site(name).xmat.reshape(3, 3), atol=1e-9)
    for eye in ("left", "right"):
        turn, place = placed[f"{eye}_camera"]
        assert np.allclose(place, data.camera(eye).xpos, atol=1e-9)
        # Of an image: x right, y down, z ahead; of MuJoCo's camera: y up, z back.
        flipped = data.camera(eye).xmat.reshape(3, 3) * [1, -1, -1]
        assert np.allclose(turn, flipped, atol=1e-9)
    sites = {"l_hand", "r_hand", "l_foot", "r_foot", "left_camera", "right_camera"}
    assert set(placed) == {"world", *sites, *bodies}


def test_measured_hands_are_in_the_body_frame(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [sample("plant/state", plant(6), 0)])
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    found = read(tmp_path / "out.mcap")
    _, data = reference(6)
    torso = data.body(BODY_FRAME)
    turn = torso.xmat.reshape(3, 3)
    for side, site in HAND_FRAMES.items():
        (one,) = found[f"/hands/{side}/measured"]
        assert one.message.frame_id == BODY_FRAME
        p, q = one.message.pose.position, one.message.pose.orientation
        assert np.allclose([p.x, p.y, p.z], turn.T @ (data.site(site).xpos - torso.xpos))
        expected = turn.T @ data.site(site).xmat.reshape(3, 3)
        assert np.allclose(matrix(q.w, q.x, q.y, q.z), expected)


def test_the_shapes_are_in_the_file_once_and_fixed_to_links(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [sample("plant/state", plant(i), i) for i in range(20)])
    export_log(tmp_path / "log.mcap", tmp_path / "out.mcap")
    found = read(tmp_path / "out.mcap")
    (scene,) = found["/robot"]
    frames = {t.child_frame_id for t in found["/tf"][0].message.transforms}
    assert len(scene.message.entities) > 25
    for entity in scene.message.entities:
        assert entity.frame_id in frames
        assert entity.frame_locked
        for shape in entity.triangles:
            assert max(shape.indices) < len(shape.points)


def test_shapes_lie_within_the_geoms_of_their_links() -> None:
    """Each link's triangles fill the box that MuJoCo puts around its geoms."""
    model, data = reference(0)
    mujoco.mj_forward(model, data)
    for name in ("torso_link", "l_knee_fe_ld", "r_elbow_fe_link"):
        points = np.concatenate([m.vertices for m in RobotModel().meshes() if m.link == name])
        body = model.body(name).id
        corners = []
        for geom in np.flatnonzero((model.geom_bodyid == body) & (model.geom_group == 2)):
            turn = matrix(*model.geom_quat[geom])
            centre, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
            extent = np.abs(turn) @ half
            middle = model.geom_pos[geom] + turn @ centre
            corners += [middle - extent, middle + extent]
        assert np.all(points.min(axis=0) >= np.min(corners, axis=0) - 1e-6)
        assert np.all(points.max(axis=0) <= np.max(corners, axis=0) + 1e-6)
        assert np.allclose(points.max(axis=0), np.max(corners, axis=0), atol=0.02)


def volume(shape: tuple[Any, Any]) -> float:
    """Enclosed volume; positive only if all triangles turn outward [m³]."""
    vertices, triangles = shape
    a, b, c = (vertices[triangles[:, i]] for i in range(3))
    return float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum() / 6.0)


def test_boxes_and_turned_solids_are_closed_and_face_outward() -> None:
    assert volume(box(np.array([0.1, 0.2, 0.3]))) == pytest.approx(8 * 0.1 * 0.2 * 0.3)
    cylinder = turned([(0.0, -0.5), (0.1, -0.5), (0.1, 0.5), (0.0, 0.5)])
    # A polygon of 20 sides is 1.6 % smaller than its circle.
    assert volume(cylinder) == pytest.approx(np.pi * 0.01, rel=0.02)
