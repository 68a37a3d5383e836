"""The described cameras are those of the compiled model."""

import mujoco
import numpy as np
import pytest

from common.robot.cameras import stereo_pair
from common.robot.frames import CAMERA_BASELINE, CAMERAS
from common.robot.rotations import matrix_from_quaternion
from services.sim.model.world import build_model

SIZE = (400, 300)


@pytest.mark.parametrize("side", ["left", "right"])
def test_a_point_is_seen_where_the_model_sees_it(side: str) -> None:
    model = build_model()
    data = mujoco.MjData(model)
    data.qpos[model.joint("neck_pitch").qposadr[0]] = 0.4
    mujoco.mj_forward(model, data)
    camera, seen = stereo_pair()[side], data.camera(CAMERAS[side])
    point = np.array([1.2, 0.3, 0.8])

    # MuJoCo's cameras look along -z with y up.
    x, y, z = seen.xmat.reshape(3, 3).T @ (point - seen.xpos)
    focal = SIZE[1] / 2 / np.tan(np.radians(float(model.cam_fovy[0])) / 2)
    expected = (199.5 - focal * x / z, 149.5 + focal * y / z)

    parent = data.body(camera.parent)
    in_parent = parent.xmat.reshape(3, 3).T @ (point - parent.xpos)
    turned = matrix_from_quaternion(np.array(camera.quaternion))
    optical = turned.T @ (in_parent - np.array(camera.position))
    u, v, w = camera.matrix(SIZE) @ optical
    np.testing.assert_allclose((u / w, v / w), expected, atol=1e-6)


def test_the_matrix_of_scaled_pictures_scales_with_them() -> None:
    camera = stereo_pair()["left"]
    whole, small = camera.matrix(SIZE), camera.matrix(SIZE, (100, 150))
    # A quarter of the width, half of the height; the outer edge of the first pixel stays -0.5.
    assert small[0, 0] == pytest.approx(whole[0, 0] / 4)
    assert small[1, 1] == pytest.approx(whole[1, 1] / 2)
    assert small[0, 2] + 0.5 == pytest.approx((whole[0, 2] + 0.5) / 4)
    assert small[1, 2] + 0.5 == pytest.approx((whole[1, 2] + 0.5) / 2)


def test_the_baseline_is_that_of_the_frames() -> None:
    left, right = (np.array(stereo_pair()[side].position) for side in ("left", "right"))
    np.testing.assert_allclose(left - right, [0.0, CAMERA_BASELINE, 0.0])
