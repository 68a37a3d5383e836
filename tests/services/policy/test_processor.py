"""The processor: normalisation, targets, pictures, and the same vector in training and service."""

import cv2
import numpy as np
import pytest

from services.policy.configuration import ChunkConfig, InputConfig, LossConfig
from services.policy.errors import ProcessorError
from services.policy.processor.actions import Command
from services.policy.processor.pictures import scale_picture
from services.policy.processor.processor import Decision, Processor
from services.policy.processor.statistics import Statistics
from services.policy.processor.targets import gait_targets
from tests.services.policy.made import SIZE, episode, small

EVERYTHING = InputConfig(
    picture_size=SIZE, gripper_closure=True, previous_setpoint=True, scene=("yaw", "lever")
)


def test_training_and_service_see_the_same_vector() -> None:
    episodes = [episode(seed) for seed in range(3)]
    processor = Processor.fit(small("trill", inputs=EVERYTHING), episodes)
    vectors = processor.episode(episodes[1])

    assert vectors.shape == (30, EVERYTHING.width)
    assert vectors.dtype == np.float32
    stored = Processor.model_validate_json(processor.model_dump_json())
    for t in (0, 1, 29):
        frame = {name: column[t] for name, column in episodes[1].items()}
        previous = Command(episodes[1]["action/hands"][max(t - 1, 0)], 0.0)
        np.testing.assert_array_equal(stored.frame(frame, previous), vectors[t])


def test_measured_numbers_are_normalised_and_the_controllers_state_is_one_of_eight() -> None:
    episodes = [episode(seed) for seed in range(3)]
    processor = Processor.fit(small("trill"), episodes)
    vectors = np.concatenate([processor.episode(arrays) for arrays in episodes])
    np.testing.assert_allclose(vectors[:, :-8].mean(axis=0), 0.0, atol=1e-5)
    np.testing.assert_allclose(vectors[:, :-8].std(axis=0), 1.0, atol=1e-4)
    np.testing.assert_array_equal(vectors[:, -8:].sum(axis=1), 1.0)
    assert vectors[0, -7] == 1.0


def test_a_number_that_never_moved_in_the_data_set_does_not_shout_in_service() -> None:
    statistics = Statistics.of(np.full((50, 1), 0.2), floor=0.01)
    assert statistics.normalise(np.array([0.21]))[0] == pytest.approx(1.0, rel=1e-5)
    np.testing.assert_allclose(
        statistics.restore(np.array([1.0], dtype=np.float32)), [0.21], rtol=1e-12
    )


@pytest.mark.parametrize("kind", ["differences", "chunks"])
def test_targets_decoded_again_are_the_set_points_of_the_episode(kind: str) -> None:
    arrays = episode(7)
    changes = {} if kind == "differences" else {"actions": ChunkConfig(steps=4)}
    processor = Processor.fit(small("trill", **changes), [arrays])
    targets = processor.targets(arrays)
    decision = Decision(targets.hands[12], targets.grasp[12], np.eye(7, dtype=np.float32)[0])
    command = processor.commands(decision, Command(arrays["action/hands"][11], 0.0))[0]
    np.testing.assert_allclose(command.hands, arrays["action/hands"][12], atol=1e-6)
    np.testing.assert_array_equal(targets.grasp[12, 0], [1.0, 0.0])


def test_a_missing_column_and_one_of_another_width_are_named() -> None:
    arrays = episode(0)
    processor = Processor.fit(small("trill"), [arrays])
    without = {name: a for name, a in arrays.items() if name != "observation/joint_velocity"}
    with pytest.raises(ProcessorError, match="expected observation/joint_velocity"):
        processor.episode(without)
    with pytest.raises(ProcessorError, match="expected 28 numbers of observation/poses, got 14"):
        processor.episode(arrays | {"observation/poses": np.zeros((30, 14))})
    with pytest.raises(ProcessorError, match="got none"):
        Processor.fit(small("trill"), [])


def test_a_request_counts_in_the_frames_before_it_while_the_robot_balances() -> None:
    state = np.array([1, 7, 1, 1, 1, 1, 1, 7, 7, 1])
    asked = np.array([0, 0, 0, 0, 0, 0, 3, 0, 0, 0])
    gait, counts = gait_targets(asked, state, 3)
    np.testing.assert_array_equal(gait, [0, 0, 0, 3, 3, 3, 3, 0, 0, 0])
    np.testing.assert_array_equal(counts, state == 1)
    np.testing.assert_array_equal(gait_targets(asked, state, 8)[0], [0, 0, 3, 3, 3, 3, 3, 0, 0, 0])
    plain, all_frames = gait_targets(asked, state, 0)
    np.testing.assert_array_equal(plain, asked)
    assert all_frames.all()
    assert small("trill", loss=LossConfig(hazard_frames=3)).loss.hazard_frames == 3


@pytest.mark.parametrize(("given", "size"), [((400, 300), (60, 45)), ((120, 90), (60, 45))])
def test_pictures_are_scaled_by_area_as_opencv_does(
    given: tuple[int, int], size: tuple[int, int]
) -> None:
    rng = np.random.default_rng(0)
    picture = rng.integers(0, 256, (given[1], given[0], 3), dtype=np.uint8)
    scaled = scale_picture(picture, size)
    expected = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
    assert scaled.shape == (size[1], size[0], 3)
    assert np.abs(scaled.astype(int) - expected).max() <= 1
    assert scale_picture(scaled, size) is scaled


def test_pictures_that_are_none_or_too_small_are_refused() -> None:
    with pytest.raises(ProcessorError, match="at least 60x45, got 40x30"):
        scale_picture(np.zeros((30, 40, 3), dtype=np.uint8), (60, 45))
    with pytest.raises(ProcessorError, match="expected a picture uint8"):
        scale_picture(np.zeros((90, 120), dtype=np.uint8), (60, 45))
