"""Pictures of the stereo pair and of runs; needs EGL."""

import os
import sys
from typing import Any

import cv2
import numpy as np
import pytest

from common.errors import ConfigError
from common.runtime.live.main import argument_parser
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_TRUTH
from services.sim.errors import RenderingUnavailableError
from services.sim.model.world import build_model
from services.sim.physics.plant import Plant
from services.sim.rendering import cameras
from services.sim.rendering.cameras import CameraConfig, CameraService, StereoRenderer, encode
from services.sim.rendering.offscreen import Offscreen
from services.sim.rendering.render import FollowCamera, contact_sheet, render_states
from tests.services.inputs import FakeInputs

from .support import MS


@pytest.fixture(scope="module")
def truth() -> Any:
    return Plant().truth()


@pytest.fixture(scope="module")
def service() -> Any:
    try:
        service = CameraService(CameraConfig(encoding="rgb8"))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    yield service
    service.close()


def frames(service: CameraService, state: Any) -> dict[str, Any]:
    inputs = FakeInputs()
    inputs.put(PLANT_TRUTH, state)
    return {output.topic.name: output.message for output in service.step(inputs, 0)}


def decode(frame: Any) -> Any:
    image = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.width, 3)
    return image.astype(float)


def teal(image: Any) -> Any:
    """Mask of the left hand's markings."""
    return (image[..., 2] > image[..., 0] + 30) & (image[..., 1] > image[..., 0] + 30)


def orange(image: Any) -> Any:
    """Mask of the right hand's markings."""
    return (image[..., 0] > image[..., 2] + 30) & (image[..., 0] > image[..., 1] + 10)


def test_both_pictures_are_upright_and_not_mirrored(service: CameraService, truth: Any) -> None:
    found = frames(service, truth)
    assert set(found) == {CAMERA_LEFT.name, CAMERA_RIGHT.name}
    for side in ("left", "right"):
        frame = found[f"camera/{side}"]
        assert (frame.eye, frame.width, frame.height) == (side, 400, 300)
        assert frame.encoding == "rgb8"
        assert frame.header.stamp == truth.header.stamp
        image = decode(frame)
        assert image[:80].mean() > image[200:280].mean() + 40, "sky above floor"
        left_hand, right_hand = np.nonzero(teal(image)), np.nonzero(orange(image))
        assert left_hand[0].size > 5
        assert right_hand[0].size > 5
        assert left_hand[0].min() > 150, "the hands are in the lower half"
        assert left_hand[1].mean() < right_hand[1].mean(), "the left hand is on the left"


def test_the_left_camera_is_on_the_left(service: CameraService, truth: Any) -> None:
    found = frames(service, truth)
    columns = [np.nonzero(teal(decode(found[f"camera/{e}"])))[1].mean() for e in ("left", "right")]
    assert columns[0] > columns[1] + 1.0, "near objects lie further right in the left picture"


def test_looking_down_shows_more_floor(service: CameraService, truth: Any) -> None:
    joints = truth.joint_position.copy()
    joints[-1] = 0.6
    down = truth.model_copy(update={"joint_position": joints})
    level_image = decode(frames(service, truth)["camera/left"])
    down_image = decode(frames(service, down)["camera/left"])
    assert down_image[:120].mean() < level_image[:120].mean() - 20


def test_only_what_somebody_wants_is_rendered(service: CameraService, truth: Any) -> None:
    service.wanted = lambda topic: topic is CAMERA_RIGHT
    assert list(frames(service, truth)) == [CAMERA_RIGHT.name]
    service.wanted = lambda topic: False
    assert frames(service, truth) == {}
    service.wanted = lambda topic: True


def test_no_new_state_no_picture(service: CameraService, truth: Any) -> None:
    inputs = FakeInputs()
    assert service.step(inputs, 0) == []
    inputs.put(PLANT_TRUTH, truth)
    assert len(service.step(inputs, 0)) == 2
    inputs.begin_step()
    assert service.step(inputs, 0) == []
    assert service.period_ns == 50 * MS


def test_rgb8_is_the_picture_itself(truth: Any) -> None:
    try:
        renderer = StereoRenderer(CameraConfig(width=64, height=48))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    image = renderer.render(truth, ["left"])[0]
    renderer.close()
    assert image.shape == (48, 64, 3)
    assert encode(image, "rgb8", 90) == image.tobytes()
    again = cv2.imdecode(np.frombuffer(encode(image, "jpeg", 95), np.uint8), cv2.IMREAD_COLOR)
    assert again is not None
    assert np.abs(again[..., ::-1].astype(float) - image).mean() < 4.0


def test_without_gl_the_message_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    with pytest.raises(RenderingUnavailableError, match="install libegl1"):
        Offscreen(build_model(), 32, 24)


@pytest.mark.parametrize(
    ("variable", "value"), [("PYOPENGL_PLATFORM", "osmesa"), ("MUJOCO_EGL_DEVICE_ID", "7")]
)
def test_variables_that_are_left_set_are_named_before_packages(
    monkeypatch: pytest.MonkeyPatch, variable: str, value: str
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    monkeypatch.setenv(variable, value)
    with pytest.raises(RenderingUnavailableError, match=f"{variable}={value}") as told:
        Offscreen(build_model(), 32, 24)
    assert "libegl1" not in str(told.value)


def test_the_follow_camera_keeps_a_walking_robot_in_the_picture(truth: Any) -> None:
    states = [
        truth.model_copy(
            update={
                "base_position": truth.base_position + np.array([0.4 * k, 0.0, 0.0]),
                "header": truth.header.model_copy(update={"stamp": truth.header.stamp + k * 10**9}),
            }
        )
        for k in range(6)
    ]
    try:
        shots = list(render_states(states, 160, 120, FollowCamera(lag=0.2), fast=True))
        fixed = list(render_states(states[:1], 160, 120, "left"))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert len(shots) == 6
    for shot in shots:
        white = (shot.min(axis=2) > 190) & (shot.max(axis=2) < 240)
        columns = np.nonzero(white[40:80])[1]
        assert abs(np.median(columns) - 80) < 20, "the white robot is in the middle"
    assert fixed[0].shape == (120, 160, 3)


def test_the_cameras_are_nice_and_take_options(monkeypatch: pytest.MonkeyPatch) -> None:
    niceness: list[int] = []
    monkeypatch.setattr(os, "nice", niceness.append)
    parser = argument_parser("cameras", cameras.DESCRIPTION)
    cameras._add_arguments(parser)
    assert parser.prog == "python -m services.sim.rendering.cameras"
    arguments = parser.parse_args(["--rate", "10", "--width", "64", "--height", "48"])
    arguments.settings = {"rate": 30, "quality": 70}
    try:
        service = cameras._build(arguments)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    service.close()
    assert service.period_ns == 100 * MS
    assert niceness == [10]
    arguments.settings = {"encoding": "gif"}
    with pytest.raises(ConfigError, match="CameraConfig is wrong"):
        cameras._build(arguments)


def test_contact_sheet_lays_frames_out_in_reading_order() -> None:
    tiles = [np.full((4, 6, 3), value, dtype=np.uint8) for value in (10, 20, 30)]
    sheet = contact_sheet(tiles, columns=2, gap=1)
    assert sheet.shape == (9, 13, 3)
    assert (sheet[0, 0, 0], sheet[0, 7, 0], sheet[5, 0, 0]) == (10, 20, 30)
    assert sheet[4, 0, 0] == sheet[5, 7, 0] == 255
    with pytest.raises(ValueError, match="at least one frame"):
        contact_sheet([], columns=2)
