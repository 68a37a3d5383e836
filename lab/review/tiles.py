"""Render the tiles of contact sheets, and the frames of videos, from a timeline. Needs OpenGL."""

from collections.abc import Callable, Iterator, Sequence

from lab.review.frames import Image, OnProgress, with_caption
from lab.review.heap import trim_heap
from lab.review.key_moments import Moment
from lab.review.timeline import Timeline
from services.sim.rendering.render import FollowCamera, render_states, task_view
from services.sim.scenes.base import View


def render_scene(
    timeline: Timeline,
    indices: Sequence[int],
    width: int,
    height: int,
    camera: FollowCamera | View | None = None,
    *,
    fast: bool = False,
) -> Iterator[Image]:
    """Render the ground truths at ``indices``, in order of time, in ``width`` x ``height`` pixels.

    Without a ``camera`` the one is used that shows the run's task best. For ``fast`` see
    :func:`services.sim.rendering.render.render_states`.

    Raises:
        RenderingUnavailableError: off-screen OpenGL is not available.
        SceneError: the scene is unknown, or changed during the run.
    """
    if camera is None:
        camera = task_view(timeline.task.task if timeline.task else "", timeline.scene)
    return render_states(
        (timeline.truth[index] for index in indices),
        *(width, height, camera),
        scene=timeline.scene,
        objects=timeline.scene_states_at(indices),
        fast=fast,
    )


def moment_tiles(
    timeline: Timeline,
    moments: Sequence[Moment],
    size: tuple[int, int],
    camera: FollowCamera | View | None,
    seconds: Callable[[int], float],
    on_progress: OnProgress,
) -> list[Image]:
    """Render one tile per moment, captioned with its label and the time that ``seconds`` gives [s].

    The moments are in order of time and ``size`` is width and height [pixels]; for ``camera`` see
    :func:`render_scene`. ``on_progress`` is called after each tile.

    Raises:
        RenderingUnavailableError: off-screen OpenGL is not available.
        SceneError: the scene is unknown, or changed during the run.
    """
    tiles: list[Image] = []
    images = render_scene(timeline, [moment.index for moment in moments], *size, camera)
    for moment, image in zip(moments, images, strict=True):
        tiles.append(with_caption(image, f"{seconds(moment.index):5.1f} s  {moment.label}"))
        on_progress(len(tiles), len(moments))
    trim_heap()
    return tiles
