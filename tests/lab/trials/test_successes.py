"""The synthetic operator does every task; how often, `make tasks` tells."""

import pytest

from lab.studies.tasks.table import line
from lab.trials.spec import TrialSpec
from lab.trials.stack import TaskStack
from services.sim.tasks import all_tasks

SEEDS = {"hardware/cap": 34}
"""Not 0: here the can stands so far aside that the hand which holds it reaches across."""


@pytest.mark.parametrize("task", list(all_tasks()))
def test_the_operator_does_the_task(task: str) -> None:
    seed = SEEDS.get(task, 0)
    stack = TaskStack(TrialSpec(task=task, seed=seed, links={}, physics_steps=5))
    result = stack.run()
    assert result.verdict == "success", line(result)
    assert result.stages == tuple(stage.name for stage in all_tasks()[task].stages)
    assert not result.gave_up
