"""Windows: the same numbers as in service, ends, noise, and shifts."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import torch

from common.episodes.episode_file import open_episode
from lab.errors import TrainingError
from lab.learning.training.config import NoiseConfig, TrainingConfig
from lab.learning.training.demonstrations import Demonstration, divide, read_demonstrations
from lab.learning.training.errors import EstimationErrors
from lab.learning.training.pictures import read_pictures
from lab.learning.training.processes import Processes
from lab.learning.training.windows import Spread, Windows, observation_spread, shifted
from services.policy.configuration import ChunkConfig, InputConfig
from services.policy.processor.actions import Command
from services.policy.processor.pictures import scale_picture
from services.policy.processor.processor import ESTIMATED, Processor
from tests.lab.learning.training.support import TASK, blind, dataset, not_asked
from tests.services.policy.made import episode, small

WINDOW = 6
CONFIG = TrainingConfig(window=WINDOW, loss_frames=2)
POLICY = blind(
    inputs=InputConfig(picture_size=(24, 18), previous_setpoint=True, gripper_closure=True),
    actions=ChunkConfig(steps=3),
)


@pytest.fixture(scope="module")
def demonstrations(tmp_path_factory: pytest.TempPathFactory) -> list[Demonstration]:
    data = dataset(tmp_path_factory.mktemp("data") / "set", 3, pictures=True)
    return read_demonstrations([data], TASK)


def windows(
    demonstrations: list[Demonstration], tmp_path: Path, config: TrainingConfig = CONFIG
) -> tuple[Windows, Processor]:
    arrays = [d.arrays for d in demonstrations]
    processor = Processor.fit(POLICY, arrays)
    pictures = read_pictures(demonstrations, POLICY.inputs, tmp_path / "pictures.npy", not_asked)
    return Windows(processor, arrays, pictures, config), processor


def test_training_and_service_see_the_same_of_a_logged_frame(
    demonstrations: list[Demonstration], tmp_path: Path
) -> None:
    made, processor = windows(demonstrations, tmp_path)
    batch = made.whole(100)[0]
    at = 0
    for demonstration in demonstrations:
        with open_episode(demonstration.path) as episode:
            for frame in range(demonstration.frames):
                window, t = at + frame // WINDOW, frame % WINDOW
                columns: dict[str, Any] = {
                    name: column[frame] for name, column in demonstration.arrays.items()
                }
                before = demonstration.arrays["action/hands"][max(frame - 1, 0)]
                served = processor.frame(columns, Command(before, 0.0))
                assert served.tobytes() == batch.observation[window, t].numpy().tobytes()
                for eye, camera in enumerate(("left", "right")):
                    # As the service decodes a camera's message.
                    file = np.frombuffer(episode.jpeg(camera, frame), dtype=np.uint8)
                    live = np.asarray(cv2.imdecode(file, cv2.IMREAD_COLOR))[:, :, ::-1]
                    picture = scale_picture(np.ascontiguousarray(live), (24, 18))
                    np.testing.assert_array_equal(picture, batch.pictures[window, t, eye])
        at += -(-demonstration.frames // WINDOW)
    assert at == len(batch.observation)


def test_frames_beyond_the_end_do_not_count(
    demonstrations: list[Demonstration], tmp_path: Path
) -> None:
    made, _ = windows(demonstrations, tmp_path)
    batch = made.whole(100)[0]
    # Ten frames are a window of six, and four frames of another.
    assert batch.targets.valid.sum(dim=1).tolist() == [6, 4] * 3
    np.testing.assert_array_equal(batch.observation[1, 4], batch.observation[1, 3])
    assert not np.array_equal(batch.observation[1, 3], batch.observation[2, 0])


def test_the_same_seed_draws_the_same_windows(
    demonstrations: list[Demonstration], tmp_path: Path
) -> None:
    made, processor = windows(demonstrations, tmp_path)
    quiet = observation_spread(processor, NoiseConfig())
    one, other, third = (made.draw(np.random.default_rng(seed), 8, quiet) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.observation, other.observation)
    assert not np.array_equal(one.observation, third.observation)
    assert one.targets.hands.shape == (8, 2, 3, 13)
    assert one.at.tolist() == sorted(set(one.at.tolist()))


def test_the_parts_of_a_batch_are_the_batch(
    demonstrations: list[Demonstration], tmp_path: Path
) -> None:
    made, processor = windows(demonstrations, tmp_path, CONFIG.model_copy(update={"shift": 2}))
    noise = observation_spread(processor, NoiseConfig(hand=0.1, hand_white=0.1))
    parts = [slice(None), Processes(0, 2).part(8), Processes(1, 2).part(8)]
    whole, *halves = (made.draw(np.random.default_rng(3), 8, noise, part=p) for p in parts)
    for place, half in enumerate(halves):
        np.testing.assert_array_equal(half.observation, whole.observation[place::2])
        np.testing.assert_array_equal(half.pictures, whole.pictures[place::2])
        np.testing.assert_array_equal(half.targets.hands, whole.targets.hands[place::2])
        assert half.at.tolist() == whole.at.tolist()
    with pytest.raises(TrainingError, match="that 3 processes can divide, got 8"):
        Processes(0, 3).part(8)


def test_noise_is_on_what_it_is_configured_for(demonstrations: list[Demonstration]) -> None:
    processor = Processor.fit(POLICY, [d.arrays for d in demonstrations])
    noise = NoiseConfig(hand=0.01, hand_white=0.003, setpoint=0.02, turn=0.04, foot=0.005)
    spread = observation_spread(processor, noise)
    scale = np.array([*processor.observation.scale, *[1.0] * 8])
    parts = iter(np.cumsum([0, *processor.inputs.parts.values()]))
    first = dict(zip(processor.inputs.parts, parts, strict=False))
    hands = first["observation/poses"] + np.array([14, 15, 16, 21, 22, 23])
    previous = first["previous_setpoint"] + np.array([0, 1, 2, 6, 7, 8])
    constant, white = np.zeros(processor.inputs.width), np.zeros(processor.inputs.width)
    constant[hands], white[hands], constant[previous] = 0.01, 0.003, 0.02
    turns = first["observation/poses"] + np.array([17, 18, 19, 20, 24, 25, 26, 27])
    # Parts of a quaternion change by half an angle, those of a rotation vector by all of it.
    constant[turns], constant[previous + 3] = 0.02, 0.04
    constant[first["observation/poses"] + np.array([0, 1, 2, 7, 8, 9])] = 0.005
    np.testing.assert_allclose(spread.constant * scale, constant, atol=1e-12)
    np.testing.assert_allclose(spread.white * scale, white, atol=1e-12)


def test_in_a_window_that_stands_still_a_frame_is_repeated_to_its_end(
    demonstrations: list[Demonstration], tmp_path: Path
) -> None:
    made, processor = windows(
        demonstrations, tmp_path, config=CONFIG.model_copy(update={"standstill": 0.5})
    )
    quiet = observation_spread(processor, NoiseConfig())
    batch = made.draw(np.random.default_rng(0), 400, quiet)
    inside = batch.targets.valid.all(dim=1).numpy()
    same = np.all(batch.observation[:, 1:].numpy() == batch.observation[:, :-1].numpy(), axis=2)
    # Once it stands, it stands to the end.
    assert np.all(same[inside, 1:] >= same[inside, :-1])
    assert 0.4 < same[inside, -1].mean() < 0.75
    assert same[inside, 0].any()


def test_windows_are_drawn_around_active_frames() -> None:
    moves = episode(1, frames=40) | {
        "action/grasp": np.zeros((40, 2)),
        "intervention": np.zeros(40, dtype=np.bool_),
    }
    # The hands rest for nine tenths of the time.
    arrays = {name: np.concatenate((np.repeat(c[:1], 360, axis=0), c)) for name, c in moves.items()}
    policy = blind(actions=ChunkConfig(steps=1, active_time=False))
    processor = Processor.fit(policy, [arrays])
    quiet, shares = observation_spread(processor, NoiseConfig()), []
    for active in (0.0, 1.0):
        config = TrainingConfig(window=WINDOW, active=active)
        made = Windows(processor, [arrays], np.empty((400, 0, 1, 1, 3), dtype=np.uint8), config)
        hands = made.draw(np.random.default_rng(0), 300, quiet).targets.hands[..., :12]
        shares.append(float((hands != hands[:, :1]).flatten(1).any(dim=1).float().mean()))
    assert shares[0] < 0.25
    assert shares[1] > 0.8


def test_the_noise_on_the_scene_is_large_where_estimates_are_bad() -> None:
    arrays = episode(1, frames=60) | {
        ESTIMATED: np.linspace(-1.0, 1.0, 60)[:, None],
        "intervention": np.zeros(60, dtype=np.bool_),
    }
    inputs = InputConfig(picture_size=(24, 18), estimated=("a",))
    processor = Processor.fit(small("trill", inputs=inputs), [arrays])
    assert processor.scene is not None
    truth = processor.scene.normalise(np.linspace(-1.0, 1.0, 400)[:, None])
    errors = EstimationErrors(truth, np.where(truth > 0.0, 1.0, 0.1).astype(np.float32))
    pictures = np.zeros((60, 2, 18, 24, 3), dtype=np.uint8)
    made = Windows(processor, [arrays], pictures, CONFIG, errors)
    quiet = observation_spread(processor, NoiseConfig())
    draws = [
        made.draw(np.random.default_rng(5), 400, quiet, spread).seen
        for spread in (None, Spread(errors.overall, np.zeros(1)))
    ]
    assert draws[0] is not None
    assert draws[1] is not None
    noise, bad = (draws[1] - draws[0]).numpy(), draws[0].numpy() > 0.3
    assert noise[bad].std() == pytest.approx(1.0, rel=0.15)
    assert noise[draws[0].numpy() < -0.3].std() == pytest.approx(0.1, rel=0.15)


def test_constant_noise_is_one_draw_for_a_window() -> None:
    rng = np.random.default_rng(0)
    constant = Spread(np.array([2.0, 0.0]), np.zeros(2)).draw(rng, 4000, 3)
    assert np.all(constant == constant[:, :1])
    np.testing.assert_allclose(constant[:, 0].std(axis=0), [2.0, 0.0], atol=0.1)
    white = Spread(np.zeros(2), np.array([2.0, 0.0])).draw(rng, 4000, 3)
    assert abs(np.corrcoef(white[:, 0, 0], white[:, 1, 0])[0, 1]) < 0.1
    np.testing.assert_allclose(white.std(axis=(0, 1)), [2.0, 0.0], atol=0.1)


def test_a_window_is_shifted_as_a_whole() -> None:
    rng = np.random.default_rng(0)
    pictures = rng.integers(0, 255, size=(5, 4, 2, 12, 16, 3), dtype=np.uint8)
    moves = np.random.default_rng(1).integers(-2, 3, size=(5, 2))
    moved = shifted(torch.from_numpy(pictures), moves).numpy()
    for given, got in zip(pictures, moved, strict=True):
        inner = given[:, :, 2:-2, 2:-2]
        fits = [
            (down, right)
            for down in range(-2, 3)
            for right in range(-2, 3)
            if np.array_equal(inner, got[:, :, 2 - down : 10 - down, 2 - right : 14 - right])
        ]
        assert len(fits) == 1
    assert not np.array_equal(pictures, moved)


def test_whole_episodes_are_held_out(demonstrations: list[Demonstration]) -> None:
    learned, held_out = divide(demonstrations, 0.34, seed=0)
    assert len(held_out) == 1
    assert {d.meta.seed for d in learned} | {d.meta.seed for d in held_out} == {0, 1, 2}
    assert all(len(divide(demonstrations, part, 0)[0]) >= 1 for part in (0.01, 0.99))
