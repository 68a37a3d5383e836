"""The pictures of an episode are those that a policy in the operator's place would have had."""

import io
from collections.abc import Mapping, Sequence
from functools import cache
from itertools import pairwise
from threading import Event

import h5py
import numpy as np
import pytest

from common.plant.config import PHYSICS_STEP_NS
from common.runtime.service import Inputs, Output, Service
from common.schemas import CameraFrame, Header
from common.topics import CAMERA_LEFT, CAMERA_RIGHT
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig
from lab.demonstrations.collect.episode import make_episode
from lab.demonstrations.collect.pictures import MomentNotes, render
from lab.errors import StoppedError
from lab.trials.stack import TaskStack
from services.sim.config import SimConfig
from services.sim.errors import RenderingUnavailableError
from services.sim.physics.plant import START_NS, Plant
from services.sim.rendering.cameras import CameraService
from tests.lab.demonstrations.collect.test_episode import BEGUN, short

SMALL = PictureConfig(width=32, height=24)
JITTERY = {"camera": "normal(80ms,30ms)"}
LINKS: tuple[Mapping[str, str], ...] = ({}, JITTERY, {"policy:camera/right": "120ms"})


class Reader(Service):
    """Takes in pictures as a policy does, twenty times a second.

    Attributes:
        seen: by the time of its step [ns], both pictures.
    """

    name = "policy"
    period_ns = 50_000_000
    reads = (CAMERA_LEFT, CAMERA_RIGHT)

    def __init__(self) -> None:
        self.seen: dict[int, tuple[CameraFrame, CameraFrame]] = {}

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        pair = inputs.latest_pair(CAMERA_LEFT, CAMERA_RIGHT)
        if pair is not None:
            self.seen[now_ns] = pair
        return ()


def settings(links: Mapping[str, str]) -> EpisodeConfig:
    return BEGUN.model_copy(update={"pictures": SMALL, "links": dict(links)})


@cache
def collected(seed: int, links: int) -> bytes:
    config = settings(LINKS[links])
    with short(config):
        content = make_episode(config, seed).content
    assert content is not None
    return content


def live(seed: int, links: int) -> dict[int, tuple[CameraFrame, CameraFrame]]:
    """What a reader sees beside cameras that do render, at each of its steps."""
    config, reader = settings(LINKS[links]), Reader()
    with short(config):
        try:
            cameras = CameraService(SMALL.camera("door"))
        except RenderingUnavailableError as error:
            pytest.skip(str(error))
        TaskStack(config.trial(seed), beside=(cameras, reader)).run()
    return reader.seen


@pytest.mark.parametrize("links", range(len(LINKS)), ids=["none", "jitter", "one eye late"])
@pytest.mark.parametrize("seed", [0, 1])
def test_frames_have_the_pictures_and_ages_of_a_live_reader(seed: int, links: int) -> None:
    seen = live(seed, links)
    with h5py.File(io.BytesIO(collected(seed, links))) as file:
        now, stamps = file["time/robot_ns"][:], file["time/picture_ns"][:]
        # The plant completes its first step when the runner's clock begins.
        ahead = START_NS + BEGUN.physics_steps * PHYSICS_STEP_NS
        expected = [seen[time - ahead] for time in now.tolist()]
        assert [left.header.stamp for left, _ in expected] == stamps.tolist()
        np.testing.assert_allclose(file["age/picture"][:], (now - stamps) * 1e-9, atol=1e-12)
        for eye in (0, 1):
            group = file[f"images/{'right' if eye else 'left'}"]
            data, offset = group["data"][:].tobytes(), group["offset"][:].tolist()
            files = [data[a:b] for a, b in pairwise(offset)]
            assert files == [pair[eye].data for pair in expected]


def test_the_cameras_tick_on_their_own_and_links_make_pictures_older() -> None:
    def ages(seed: int, links: int) -> list[float]:
        with h5py.File(io.BytesIO(collected(seed, links))) as file:
            return [float(age) for age in file["age/picture"][:]]

    undelayed = [age for seed in (0, 1) for age in ages(seed, 0)]
    # Up to a period of the truth and one of the cameras.
    assert 0.0 <= min(undelayed) < max(undelayed) <= 0.07
    assert abs(np.mean(ages(0, 0)) - np.mean(ages(1, 0))) > 0.005
    late = np.mean(ages(0, 1)) - np.mean(ages(0, 0))
    assert 0.05 < late < 0.12
    assert min(ages(0, 2)) >= 0.12


def test_the_same_moment_is_rendered_once_and_what_was_shown_before_leaves_no_trace() -> None:
    plant = Plant(SimConfig(task="door/unlock"))
    notes = MomentNotes("door")
    state = plant.truth()
    plant.data.joint("door_hinge").qpos[:] = 1.0
    assert notes.files(state, ("left", "right"), None) == [b"", b""]
    later = state.model_copy(update={"header": Header(stamp=state.header.stamp + 1)})
    notes.files(later, ("left",), plant.view.state(plant.now_ns, 0))
    closed, opened = notes.moments.values()
    try:
        made = render("door/unlock", SMALL, [closed, opened, opened, closed], Event())
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    left = made["left"]
    assert left[1] is left[2]
    assert left[0] != left[1]
    # Without objects the scene stays as it was, and a new episode begins at its start.
    assert left[3] == left[1]
    assert render("door/unlock", SMALL, [closed], Event())["left"] == left[:1]


def test_rendering_can_be_stopped() -> None:
    stop, plant = Event(), Plant(SimConfig(task="door/unlock"))
    stop.set()
    with pytest.raises(StoppedError):
        render("door/unlock", SMALL, [(plant.truth(), None)], stop)
