"""The left eye is on the left, the image is upright and nothing of the head is in the way."""

from collections.abc import Iterator
from typing import Any

import mujoco
import numpy as np
import pytest

from common.robot import frames, joints

from .support import Array, set_joints

WIDTH, HEIGHT = 320, 240
DEPTH = 1.2  # of each marker ahead of the cameras, m
MARKERS = {"red": (0.5, -0.2), "blue": (-0.5, -0.2), "green": (0.0, 0.5)}  # (left, up), m


def _with_markers() -> Any:
    """Robot with three coloured spheres around the eyes' nominal line of sight."""
    spec = mujoco.MjSpec.from_file(str(joints.MJCF_PATH))
    eyes = np.array([0.0625, 0.0, joints.NOMINAL_BASE_HEIGHT + 0.452])
    for i, (name, (left, up)) in enumerate(MARKERS.items()):
        spec.worldbody.add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_SPHERE,
            size=[0.06, 0, 0],
            pos=eyes + np.array([DEPTH, left, up]),
            rgba=[float(i == 0), float(i == 2), float(i == 1), 1.0],
        )
    return spec.compile()


@pytest.fixture(scope="module")
def labels() -> Iterator[dict[str, Any]]:
    """Per eye, the geom id seen at each pixel (row 0 on top), and the model under "model"."""
    model = _with_markers()
    data = mujoco.MjData(model)
    set_joints(model, data, dict(zip(joints.JOINT_NAMES, joints.NOMINAL_POSITION, strict=True)))
    data.qpos[2] = joints.NOMINAL_BASE_HEIGHT
    mujoco.mj_forward(model, data)
    try:
        renderer = mujoco.Renderer(model, HEIGHT, WIDTH)
    except (ImportError, AttributeError, RuntimeError, mujoco.FatalError) as error:
        pytest.skip(f"no offscreen OpenGL here: {error}")
    renderer.enable_segmentation_rendering()
    images: dict[str, Any] = {"model": model}
    for eye, camera in frames.CAMERAS.items():
        renderer.update_scene(data, camera)
        images[eye] = renderer.render()[:, :, 0].copy()
    yield images
    renderer.close()


def _centre(labels: dict[str, Any], eye: str, marker: str) -> Array:
    """(column, row) of a marker's centroid, pixels."""
    rows, columns = np.nonzero(labels[eye] == labels["model"].geom(marker).id)
    assert len(rows) > 20
    return np.array([columns.mean(), rows.mean()])


def test_cameras_sit_on_their_own_side_and_look_ahead(nominal: Any) -> None:
    left, right = (nominal.camera(frames.CAMERAS[side]) for side in ("left", "right"))
    assert left.xpos == pytest.approx([0.0625, 0.03, 1.195], abs=1e-9)
    assert left.xpos - right.xpos == pytest.approx([0, frames.CAMERA_BASELINE, 0], abs=1e-12)
    for camera in (left, right):
        axes = camera.xmat.reshape(3, 3)
        assert -axes[:, 2] == pytest.approx([1, 0, 0], abs=1e-12)
        assert axes[:, 1] == pytest.approx([0, 0, 1], abs=1e-12)


def test_what_is_on_the_left_appears_on_the_left(labels: dict[str, Any]) -> None:
    for eye in frames.CAMERAS:
        assert _centre(labels, eye, "red")[0] < WIDTH / 2 < _centre(labels, eye, "blue")[0]


def test_up_is_up(labels: dict[str, Any]) -> None:
    for eye in frames.CAMERAS:
        assert _centre(labels, eye, "green")[1] < HEIGHT / 2 < _centre(labels, eye, "red")[1]


def test_disparity_is_that_of_a_60_mm_baseline(labels: dict[str, Any]) -> None:
    focal = HEIGHT / 2 / np.tan(np.deg2rad(frames.CAMERA_FOVY_DEG / 2))
    for marker in MARKERS:
        shift = _centre(labels, "left", marker) - _centre(labels, "right", marker)
        assert shift[0] == pytest.approx(focal * frames.CAMERA_BASELINE / DEPTH, abs=0.7)
        assert shift[1] == pytest.approx(0.0, abs=0.3)


def test_the_head_does_not_see_itself(labels: dict[str, Any]) -> None:
    model = labels["model"]
    head = model.body(frames.HEAD_FRAME).id
    own = [i for i in range(model.ngeom) if model.geom_bodyid[i] == head]
    for eye in frames.CAMERAS:
        assert not np.isin(labels[eye], own).any()


def test_both_hands_are_in_view(labels: dict[str, Any]) -> None:
    """At the nominal pose each eye sees the left hand left of the right hand."""
    model = labels["model"]
    for eye in frames.CAMERAS:
        columns = []
        for side in "lr":
            bodies = [model.body(f"{side}_finger_{f}_link").id for f in "ab"]
            geoms = [i for i in range(model.ngeom) if model.geom_bodyid[i] in bodies]
            seen = np.nonzero(np.isin(labels[eye], geoms))[1]
            assert len(seen) > 10
            columns.append(seen.mean())
        assert columns[0] < WIDTH / 2 < columns[1]
