"""The scene from an episode's ground truth is the scene that the plant tells a policy."""

import numpy as np
import pytest

from common.episodes.observation import truth
from common.episodes.oracle import oracle_names, oracle_numbers
from lab.errors import TrainingError
from lab.learning.training.recipes import SCENES
from lab.learning.training.truth import TruthReader
from lab.learning.training.views import labelled_objects
from services.sim.config import SimConfig
from services.sim.physics.plant import Plant


@pytest.mark.parametrize("task", ["door/push", "bench/hammer"])
def test_training_and_service_are_told_the_same(task: str) -> None:
    plant = Plant(SimConfig(task=task, seed=3))
    state, scene = plant.truth(), plant.view.state(plant.now_ns, 0)
    names, reader = oracle_names(scene), TruthReader(task)
    arrays = {path: np.array([value]) for path, value in truth(state, scene).items()}
    assert reader.names() == names
    np.testing.assert_allclose(
        reader.numbers(names, arrays)[0], oracle_numbers(names, state, scene), atol=1e-9
    )


@pytest.mark.parametrize("task", SCENES)
def test_a_task_has_the_numbers_that_its_policies_know(task: str) -> None:
    names = TruthReader(task).names(SCENES[task])
    assert set(SCENES[task]) <= {part for name in names for part in (name, name.split(".")[0])}
    # Something to tie a key point of the encoder to.
    assert labelled_objects(names)


def test_objects_and_numbers_are_chosen_by_name() -> None:
    reader = TruthReader("door/unlock")
    names = reader.names(("lever_grip", "door_hinge", "leaf.y"))
    assert names[:3] == ("lever_grip.x", "lever_grip.y", "lever_grip.z")
    assert names[-2:] == ("door_hinge", "leaf.y")
    assert labelled_objects(names) == ["lever_grip"]
    with pytest.raises(TrainingError, match=r"got 'hammer'; it has leaf\.x"):
        reader.names(("hammer",))
