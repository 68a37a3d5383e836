"""Renders views with labels: what the robot would see, and the simulator's answer to where it is.

The labels come free from the simulator; a real robot has none, so this is for simulation, and for
networks that are to be tuned on real pictures afterwards.
"""

from collections.abc import Callable, Iterator, Sequence
from math import radians, tan
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.episodes.oracle import oracle_numbers
from common.robot.cameras import stereo_pair
from common.robot.pose import Pose
from common.robot.rotations import multiply, quaternion_from_rotation_vector, rotate_about_z
from common.schemas import PlantState, SceneState
from common.schemas.arrays import Float64Array as Array
from lab.errors import TrainingError
from lab.learning.training.config import ViewsConfig
from lab.learning.training.demonstrations import Demonstration
from lab.learning.training.truth import TRUTH, TruthReader
from services.policy.configuration import InputConfig
from services.policy.processor.pictures import Picture, scale_picture
from services.sim.rendering.cameras import CameraConfig, StereoRenderer


class Views(NamedTuple):
    """Rendered views, n of them.

    Attributes:
        pictures: (n, cameras, height, width, 3) as a policy sees them.
        labels: (n, m) numbers of the scene, m or rad.
        points: (n, cameras, objects, 2) where the objects are in the pictures, from -1 (left edge,
            top edge) to 1; NaN behind the camera. Objects are the landmarks, or else those with a
            position among the labels, in their order.
    """

    pictures: Picture
    labels: Array
    points: Array


def labelled_objects(names: Sequence[str]) -> list[str]:
    """Return the objects of which ``names`` of the scene's numbers have the whole position."""
    return [n[:-2] for n in names if n.endswith(".x") and {n[:-1] + "y", n[:-1] + "z"} <= {*names}]


def render_views(
    reader: TruthReader,
    demonstrations: Sequence[Demonstration],
    inputs: InputConfig,
    size: tuple[int, int],
    config: ViewsConfig,
    count: int,
    rng: np.random.Generator,
    advance: Callable[[], None] = lambda: None,
) -> Views:
    """Return ``count`` views of random frames with the torso moved.

    Args:
        reader: poses robot and scene.
        demonstrations: whose frames they are.
        inputs: of the policy: cameras, size of its pictures, names of the labels.
        size: width and height of the robot's cameras [pixels].
        config: how far the torso is moved, and the landmarks.
        count: number of views.
        rng: draws frames and moves.
        advance: called after each view.

    Raises:
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    cameras, (width, height) = inputs.cameras, inputs.picture_size
    objects = config.landmarks or labelled_objects(inputs.estimated)
    pictures = np.empty((count, len(cameras), height, width, 3), dtype=np.uint8)
    points = np.empty((count, len(cameras), len(objects), 2))
    labels = []
    renderer = StereoRenderer(CameraConfig(scene=reader.scene, width=size[0], height=size[1]))
    try:
        for i in range(count):
            state, scene = _posed(reader, demonstrations, config, rng)
            views = renderer.render(state, cameras, scene)
            pictures[i] = [scale_picture(view, inputs.picture_size) for view in views]
            labels.append(oracle_numbers(inputs.estimated, state, scene))
            points[i] = [_projected(reader, camera, size, scene, objects) for camera in cameras]
            advance()
    finally:
        renderer.close()
    return Views(pictures, np.array(labels), points)


def rendered(
    reader: TruthReader, cameras: Sequence[str], size: tuple[int, int], shown: Demonstration
) -> Iterator[list[Picture]]:
    """Yield the pictures of each frame of a demonstration, rendered from its ground truth.

    Args:
        reader: poses robot and scene.
        cameras: of the robot.
        size: width and height of the pictures [pixels].
        shown: the demonstration.

    Raises:
        TrainingError: it has no ground truth.
        RenderingUnavailableError: there is no off-screen OpenGL.
    """
    if not shown.arrays[TRUTH[-1]].size:
        raise TrainingError(
            f"{shown.path} has neither pictures nor ground truth, by which they could be rendered; "
            "collect with pictures, or train with --inputs blind"
        )
    renderer = StereoRenderer(CameraConfig(scene=reader.scene, width=size[0], height=size[1]))
    try:
        for frame in range(shown.frames):
            state, scene = reader.at(shown.arrays, frame)
            yield renderer.render(state, cameras, scene)
    finally:
        renderer.close()


def _posed(
    reader: TruthReader,
    demonstrations: Sequence[Demonstration],
    config: ViewsConfig,
    rng: np.random.Generator,
) -> tuple[PlantState, SceneState]:
    """Return robot and scene of a random frame, with the torso moved."""
    arrays, frame = _random_frame(demonstrations, rng)
    state, _ = reader.at(arrays, frame)
    along, across, up = rng.normal(scale=(config.along, config.across, config.up))
    turn = rng.normal(scale=(config.tilt, config.tilt, config.yaw))
    heading = Pose(state.base_position, state.base_quaternion).yaw
    moved = state.model_copy(
        update={
            "base_position": state.base_position
            + rotate_about_z(np.array([along, across, up]), heading),
            "base_quaternion": multiply(
                state.base_quaternion, quaternion_from_rotation_vector(turn)
            ),
        }
    )
    if rng.uniform() < config.other_scene:
        arrays, frame = _random_frame(demonstrations, rng)
    return moved, reader.pose(moved, arrays["truth/scene_qpos"][frame])


def _random_frame(
    demonstrations: Sequence[Demonstration], rng: np.random.Generator
) -> tuple[dict[str, Any], int]:
    chosen = demonstrations[int(rng.integers(len(demonstrations)))]
    return chosen.arrays, int(rng.integers(chosen.frames))


def _projected(
    reader: TruthReader,
    camera: str,
    size: tuple[int, int],
    scene: SceneState,
    objects: Sequence[str],
) -> NDArray[np.float64]:
    """Return where objects are in a camera's picture (n, 2), as in :class:`Views`."""
    position, axes = reader.camera(camera)
    places = {placed.name: placed.position for placed in (*scene.objects, *scene.marks)}
    # x right, y up, and the camera looks along -z.
    local = np.array([axes.T @ (places[name] - position) for name in objects]).reshape(-1, 3)
    half = tan(radians(stereo_pair()[camera].fovy_deg) / 2.0)
    depth = np.where(local[:, 2] < 0.0, -local[:, 2], np.nan)
    across = local[:, 0] / depth / (half * size[0] / size[1])
    return np.stack((across, -local[:, 1] / depth / half), axis=1)
