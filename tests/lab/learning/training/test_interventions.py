"""Of an episode with a policy and a helper, what the helper did is learned."""

from pathlib import Path

import cv2
import numpy as np
import pytest

from common.episodes.episode_file import open_episode
from lab.errors import TrainingError
from lab.learning.training import demonstrations as module
from lab.learning.training.config import InterventionConfig, TrainingConfig
from lab.learning.training.demonstrations import divide, in_words, read_demonstrations
from lab.learning.training.pictures import read_pictures
from lab.learning.training.windows import Windows, observation_spread
from services.policy.configuration import InputConfig
from services.policy.processor.processor import Processor
from tests.lab.learning.training.support import TASK, blind, dataset, not_asked

HELPED = ((1, 4), (6, 9), (9, 10))
"""Two interventions, of three and of four frames; episodes end with the tenth."""


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "SHORTEST", 3)


def test_only_the_frames_of_the_helper_are_shown_with_their_pictures(tmp_path: Path) -> None:
    data = dataset(tmp_path / "set", 2, pictures=True, operator="mixed", helped=HELPED)
    found = read_demonstrations([data], TASK)
    assert [(d.path.name, d.first, d.frames) for d in found] == [
        *(("000000.h5", 1, 3), ("000000.h5", 6, 4)),
        *(("000001.h5", 1, 3), ("000001.h5", 6, 4)),
    ]
    with open_episode(found[1].path) as episode:
        for name, values in found[1].arrays.items():
            np.testing.assert_array_equal(values, episode.array(name, slice(6, 10)))
        inputs = InputConfig(picture_size=(48, 36))
        pictures = read_pictures(found[1:2], inputs, tmp_path / "pictures.npy", not_asked)
        seen = cv2.absdiff(pictures[0, 0], np.asarray(episode.picture("left", 6)))
        assert seen.max() == 0
    assert in_words(found) == "4 interventions (100 % of the frames)"


def test_a_policy_is_no_demonstrator_unless_it_is_asked_for(tmp_path: Path) -> None:
    alone = dataset(tmp_path / "alone", 2, operator="policy")
    with pytest.raises(TrainingError, match="what a policy does alone does not count"):
        read_demonstrations([alone], TASK)
    assert [d.frames for d in read_demonstrations([alone], TASK, policy_frames=True)] == [10, 10]
    mixed = dataset(tmp_path / "mixed", 2, operator="mixed", helped=HELPED)
    assert [d.frames for d in read_demonstrations([mixed], TASK, policy_frames=True)] == [10, 10]


def test_several_data_sets_are_told_apart_in_words(tmp_path: Path) -> None:
    plain = dataset(tmp_path / "plain", 2)
    mixed = dataset(tmp_path / "mixed", 1, operator="mixed", helped=HELPED)
    found = read_demonstrations([plain, mixed], TASK)
    assert in_words(found) == "2 demonstrations (synthetic), 2 interventions (26 % of the frames)"


def test_the_interventions_of_an_episode_are_held_out_together(tmp_path: Path) -> None:
    data = dataset(tmp_path / "set", 5, operator="mixed", helped=HELPED)
    learned, held_out = divide(read_demonstrations([data], TASK), 0.4, seed=1)
    assert len(held_out) == 4
    assert {d.path for d in learned}.isdisjoint(d.path for d in held_out)


def test_a_share_of_the_windows_begins_in_interventions(tmp_path: Path) -> None:
    plain = dataset(tmp_path / "plain", 5)
    mixed = dataset(tmp_path / "mixed", 1, operator="mixed", helped=((1, 4),))
    arrays = [d.arrays for d in read_demonstrations([plain, mixed], TASK)]
    processor = Processor.fit(blind(), arrays)
    none = np.empty((sum(len(a["action/neck"]) for a in arrays), 0, 1, 1, 3), dtype=np.uint8)

    def helped(share: float | None) -> float:
        config = TrainingConfig(window=2, interventions=InterventionConfig(share=share))
        made = Windows(processor, arrays, none, config)
        quiet = observation_spread(processor, config.noise)
        batch = made.draw(np.random.default_rng(0), 2000, quiet)
        last = made.whole(1000)[0].observation[-2:, 0]
        begins = batch.observation[:, :1] == last[None]
        return float(begins.all(dim=2).any(dim=1).float().mean())

    # The last two windows begin with the first and the third frame of the intervention. The first
    # demonstration has two frames that are the same.
    assert helped(None) == pytest.approx(4 / 53, abs=0.02)
    assert helped(0.5) == pytest.approx(0.5 * 2 / 3 + 0.5 * 2 / 50, abs=0.04)
