"""Views with labels: what is drawn is where the labels say."""

import mujoco
import numpy as np
import pytest

from common.robot.cameras import stereo_pair
from common.robot.rotations import rotate_vector
from lab.learning.training.config import ViewsConfig
from lab.learning.training.demonstrations import Demonstration, read_demonstrations
from lab.learning.training.truth import TruthReader
from lab.learning.training.views import Views, render_views
from services.policy.configuration import InputConfig
from services.sim.errors import RenderingUnavailableError
from services.sim.model.robot_state import show_state
from services.sim.model.world import build_model, find_addresses
from tests.lab.learning.training.support import TASK, dataset

NAMES = tuple(f"lever_grip.{part}" for part in "xyz")
INPUTS = InputConfig(picture_size=(80, 60), estimated=NAMES)
SIZE = (160, 120)


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory: pytest.TempPathFactory) -> list[Demonstration]:
    return read_demonstrations([dataset(tmp_path_factory.mktemp("data") / "set", 3)], TASK)


def rendered(demonstrations: list[Demonstration], config: ViewsConfig, seed: int) -> Views:
    reader, rng = TruthReader(TASK), np.random.default_rng(seed)
    try:
        return render_views(reader, demonstrations, INPUTS, SIZE, config, 4, rng)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))


def test_points_are_where_the_cameras_of_the_data_format_see_them(
    demonstrations: list[Demonstration],
) -> None:
    """The label in the body frame, through the camera's published matrix and pose."""
    still = ViewsConfig(along=0.0, across=0.0, up=0.0, yaw=0.0, tilt=0.0, other_scene=0.0)
    views = rendered(demonstrations, still, 0)
    model = build_model("door")
    data, addresses = mujoco.MjData(model), find_addresses(model)
    state, scene = TruthReader(TASK).at(demonstrations[0].arrays, 0)
    show_state(model, data, addresses, state, scene)
    torso = data.xpos[addresses.torso]
    for label, points in zip(views.labels, views.points, strict=True):
        for eye, camera in enumerate(stereo_pair().values()):
            # The robot stands upright and faces +x in these demonstrations, all joints zero.
            parent = data.body(camera.parent)
            back = parent.xquat * [1.0, -1.0, -1.0, -1.0]
            in_parent = rotate_vector(back, label + torso - parent.xpos)
            optical = np.array(camera.quaternion) * [1.0, -1.0, -1.0, -1.0]
            ray = camera.matrix(SIZE) @ rotate_vector(
                optical, in_parent - np.array(camera.position)
            )
            pixel = (points[eye, 0] + 1.0) * np.array(SIZE) / 2.0 - 0.5
            np.testing.assert_allclose(pixel, ray[:2] / ray[2], atol=0.01)


def test_views_differ_by_the_seed_alone(demonstrations: list[Demonstration]) -> None:
    one, same, other = (rendered(demonstrations, ViewsConfig(), seed) for seed in (0, 0, 1))
    assert one.pictures.shape == (4, 2, 60, 80, 3)
    for part in range(3):
        np.testing.assert_array_equal(one[part], same[part])
        assert not np.array_equal(one[part], other[part])
    assert len({tuple(label) for label in one.labels.tolist()}) == 4


def test_the_lever_moves_in_the_pictures_as_its_label_says(
    demonstrations: list[Demonstration],
) -> None:
    views = rendered(demonstrations, ViewsConfig(along=0.0, up=0.0, yaw=0.0, tilt=0.0), 0)
    # y points left. What is near is further left in the right picture than in the left one.
    order = np.argsort(views.labels[:, 1])
    assert np.all(np.diff(views.points[order, 0, 0, 0]) < 0.0)
    assert np.all(views.points[:, 0, 0, 0] > views.points[:, 1, 0, 0])


def test_landmarks_are_seen_in_place_of_what_is_estimated(
    demonstrations: list[Demonstration],
) -> None:
    estimated = rendered(demonstrations, ViewsConfig(), 0)
    other = rendered(demonstrations, ViewsConfig(landmarks=("lever_grip", "leaf")), 0)
    np.testing.assert_array_equal(other.labels, estimated.labels)
    assert other.points.shape == (4, 2, 2, 2)
    np.testing.assert_array_equal(other.points[:, :, :1], estimated.points)
