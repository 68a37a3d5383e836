"""What a camera cannot see is left out, and nothing else; needs EGL."""

import mujoco
import numpy as np
import pytest

from common.robot.frames import CAMERAS
from services.sim.errors import RenderingUnavailableError
from services.sim.model.world import build_model
from services.sim.physics.plant import Plant
from services.sim.rendering.cameras import CameraConfig, StereoRenderer
from services.sim.rendering.culling import Culling


@pytest.mark.parametrize("neck", [0.0, 0.6])
def test_pictures_are_the_same_with_a_part_of_the_geoms(
    monkeypatch: pytest.MonkeyPatch, neck: float
) -> None:
    plant = Plant()
    plant.data.joint("neck_pitch").qpos[:] = neck
    try:
        renderer = StereoRenderer(CameraConfig(scene="bench", width=160, height=120))
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    model = renderer._model
    try:
        few = renderer.render(plant.truth(), list(CAMERAS))
        assert few[0].tobytes() == renderer.render(plant.truth(), ["left"])[0].tobytes()
        seen = np.count_nonzero(model.geom_group <= 2)
        model.geom_group[:] = build_model("bench").geom_group
        monkeypatch.setattr(Culling, "hide_unseen", lambda *_: None)
        drawn = np.count_nonzero(model.geom_group <= 2)
        every = renderer.render(plant.truth(), list(CAMERAS))
    finally:
        renderer.close()
    assert 20 < seen < 0.8 * drawn
    for one, other in zip(few, every, strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(("y", "group"), [(2.2, 0), (2.25, 5)])
def test_a_geom_goes_when_its_sphere_leaves_the_picture(y: float, group: int) -> None:
    """At 1 m half the picture is 2 m wide; its edge leaves a sphere of 0.1 m at 2 + 0.1 √5 m."""
    model = mujoco.MjModel.from_xml_string(
        f"""<mujoco><worldbody><geom size="0.1" pos="1 {y} 0"/>
        <camera name="eye" xyaxes="0 -1 0 0 0 1" fovy="90"/></worldbody></mujoco>"""
    )
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    scene, camera = mujoco.MjvScene(model, 10), mujoco.MjvCamera()
    camera.type, camera.fixedcamid = mujoco.mjtCamera.mjCAMERA_FIXED, 0
    mujoco.mjv_updateCamera(model, data, camera, scene)
    Culling(model, 2.0).hide_unseen(data, scene)
    assert model.geom_group[0] == group
