"""What the options of a training mean."""

import pytest

from common.errors import ConfigError
from lab.learning.training.recipes import TASKS, recipe, task_settings
from lab.learning.training.truth import TruthReader
from lab.learning.training.views import labelled_objects
from services.policy.configuration import ChunkConfig, DifferenceConfig
from services.policy.kinds import CONFIGS
from services.policy.trill.configuration import GaitNetworkConfig, TrillConfig
from services.sim.tasks import all_tasks

NAMES = ("lever_grip.x", "door_hinge")


def test_the_paper_recipe_changes_nothing_of_the_paper_network() -> None:
    policy, training = recipe("trill", "paper", "paper", "pictures", NAMES)
    assert policy == TrillConfig()
    assert isinstance(policy.actions, DifferenceConfig)
    assert (training.batch, training.window, training.rate) == (16, 10, 1e-4)
    assert (training.schedule, training.steps, training.clip) == ("constant", 320_000, 0.0)


@pytest.mark.parametrize("kind", ["trill", "bc-rnn", "bc"])
def test_every_kind_has_every_recipe_and_profile(kind: str) -> None:
    for profile in ("cpu", "paper"):
        for name in ("paper", "chunks"):
            policy, _ = recipe(kind, profile, name, "pictures", NAMES)
            assert policy.inputs.cameras == ("left", "right")
            assert isinstance(policy.actions, ChunkConfig) == (name == "chunks")
            assert policy.inputs.estimated == (NAMES if name == "chunks" else ())


@pytest.mark.parametrize("task", ["door/walk", "bench/walk"])
def test_a_task_of_walking_has_landmarks_and_a_network_for_the_gaits(task: str) -> None:
    own = task_settings("trill", task)
    policy, training = recipe("trill", "cpu", "chunks", "pictures", NAMES, own)
    assert isinstance(policy, TrillConfig)
    assert policy.gait_network == GaitNetworkConfig()
    landmarks = list(training.views.landmarks)
    assert landmarks
    assert labelled_objects(TruthReader(task).names(training.views.landmarks)) == landmarks


def test_inputs_decide_what_is_known_of_the_scene() -> None:
    told = recipe("trill", "cpu", "chunks", "scene", NAMES).policy.inputs
    blind = recipe("trill", "cpu", "chunks", "blind", NAMES).policy.inputs
    assert (told.scene, told.estimated, told.cameras) == (NAMES, (), ())
    assert (blind.scene, blind.estimated, blind.cameras) == ((), (), ())


def test_changes_are_laid_over_the_preset() -> None:
    changes = {"policy": {"actions": {"steps": 7}}, "training": {"noise": {"hand": 0.5}}}
    policy, training = recipe("trill", "cpu", "chunks", "blind", changes=changes)
    assert policy.actions == ChunkConfig(steps=7)
    assert (training.noise.hand, training.noise.setpoint) == (0.5, 0.02)


def test_an_unknown_setting_is_named() -> None:
    with pytest.raises(ConfigError, match=r"rat: unknown|rat.*not permitted|rat"):
        recipe("trill", "cpu", "chunks", "blind", changes={"training": {"rat": 1.0}})


@pytest.mark.parametrize("task", TASKS)
def test_what_a_task_needs_fits_every_kind_and_is_overruled_by_options(task: str) -> None:
    assert task in all_tasks()
    for kind in CONFIGS:
        policy, training = recipe(kind, "cpu", "chunks", "blind", changes=task_settings(kind, task))
        assert isinstance(policy.actions, ChunkConfig)
        assert training != recipe(kind, "cpu", "chunks", "blind").training
