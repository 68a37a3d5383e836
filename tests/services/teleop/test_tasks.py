"""Whole tasks: plant, controller and synthetic operator in simulated time."""

from functools import cache

import pytest

from common.links.spec import LinkSpec
from common.schemas import LinkChange, Setpoint, TaskVerdict
from common.topics import LINK_CHANGE, TELEOP_SETPOINT
from lab.studies.tasks.command import main
from lab.studies.tasks.table import line, summary
from lab.trials.options import seed_range
from lab.trials.spec import TrialResult, TrialSpec
from lab.trials.stack import TaskStack
from services.sim.tasks import find_task


@cache
def unlocked(seed: int, repeat: int = 0, link: str = "") -> tuple[TrialResult, str]:
    """One door; ``repeat`` sets repetitions of the same trial apart."""
    assert repeat >= 0
    links = {"both": link} if link else None
    stack = TaskStack(
        TrialSpec(task="door/unlock", seed=seed, links=links, physics_steps=5), record=True
    )
    return stack.run(), stack.runner.digest()


def furthest_right(seed: int) -> float:
    """How far before the body the right hand was sent [m]."""
    stack = TaskStack(TrialSpec(task="door/unlock", seed=seed, physics_steps=5))
    furthest = [0.0]

    def note(setpoint: Setpoint) -> None:
        furthest[0] = max(furthest[0], float(setpoint.right_hand_position_in_body[0]))

    stack.runner.on_message(TELEOP_SETPOINT, note)
    assert stack.run().verdict == "success"
    return furthest[0]


def test_a_door_is_unlocked() -> None:
    result, _ = unlocked(0)
    assert result.verdict == "success", line(result)
    assert result.stages == ("lever pressed", "door ajar", "door unlocked")
    assert not result.gave_up


def test_same_seed_same_bytes_and_another_seed_differs() -> None:
    assert unlocked(0)[1] == unlocked(0, 1)[1]
    other, digest = unlocked(1)
    assert other.verdict == "success", line(other)
    assert digest != unlocked(0)[1]


def test_the_operator_has_two_ways_of_opening_a_door() -> None:
    # With seed 0 the fist on the lever pushes as well, with seed 1 the other does.
    assert furthest_right(0) < 0.35
    assert furthest_right(1) > 0.45


def test_with_a_quarter_of_a_second_each_way_it_takes_longer() -> None:
    longer = 0.0
    for seed in (0, 1):
        late, _ = unlocked(seed, link="250ms")
        assert late.verdict == "success", line(late)
        longer += late.time - unlocked(seed)[0].time
    # How often it waits to see depends on what happens: of one seed alone nothing is sure.
    assert longer > 1.5


def result(seed: int, verdict: TaskVerdict, time: float) -> TrialResult:
    name = verdict.name.lower()
    return TrialResult(
        task="door/walk",
        seed=seed,
        verdict=name,
        time=time,
        reason=f"it was a {name}",
        simulated=10.0,
        wall=5.0,
        links={"both": "250ms"} if seed else {},
    )


def test_the_table_counts_and_gives_reasons() -> None:
    table = summary(
        [
            result(0, TaskVerdict.SUCCESS, 5.0),
            result(1, TaskVerdict.SUCCESS, 9.0),
            result(2, TaskVerdict.FAILURE, 70.0),
        ]
    )
    assert "| door/walk | none, both=250ms | 3 | 2 | 0 | 1 | 7.0 (5.0 to 9.0) | 2.00 x |" in table
    assert "1 x door/walk failure: it was a failure" in table


def test_seeds_are_one_or_a_range() -> None:
    assert list(seed_range("3")) == [3]
    assert list(seed_range("2:5")) == [2, 3, 4]
    with pytest.raises(SystemExit) as stop:
        main(["run", "door/unlock", "--seeds", "5:2"])
    assert stop.value.code == 2


def injected(task: str, links: dict[str, str] | None) -> dict[str, str]:
    """What the runner of a trial really delays: ``consumer:topic`` to specification."""
    stack = TaskStack(TrialSpec(task=task, seed=0, links=links, physics_steps=5))
    told: list[LinkChange] = []
    stack.runner.on_message(LINK_CHANGE, told.append)
    try:
        stack.runner.run_for(0.05)
    finally:
        stack.runner.close()
    assert stack.links == (find_task(task).links if links is None else links)
    return {f"{change.service}:{change.topic}": change.link for change in told}


def test_a_hardware_task_has_its_own_link_unless_others_are_given() -> None:
    paper = str(LinkSpec.parse("paper"))
    assert injected("hardware/tool", None) == {
        "wbc:teleop/setpoint": paper,
        "wbc:teleop/gait": paper,
    }
    assert injected("hardware/tool", {}) == {}
    assert set(injected("hardware/tool", {"command": "40ms"}).values()) == {"40ms"}
    assert injected("door/unlock", None) == {}


def test_a_wrong_link_is_told(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["run", "door/unlock", "--link", "comand=1s"]) == 2
    assert "no topic 'comand'" in capsys.readouterr().err
