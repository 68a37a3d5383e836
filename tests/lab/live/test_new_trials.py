"""New trials for new operators."""

import pytest

from common.schemas import (
    GuardMode,
    Header,
    OperatorStatus,
    PlantStatus,
    TaskStatus,
    TaskVerdict,
)
from lab.live.new_trials import REJOIN_TIME, Arrival, OperatorArrivals
from lab.monitor.bus_stats import ServiceRow, Snapshot
from tests.lab.live.test_task_judge import task_status
from tests.lab.review.synthetic import FakeRobot
from tests.lab.review.synthetic_task import health, status
from tests.services.teleop.support import plant_status


def with_operators(
    task: TaskStatus | None,
    *operators: tuple[str, int],
    plant: PlantStatus | None = None,
    finished: int = 0,
) -> Snapshot:
    """A bus with these services, each with its boot id; ``finished``: boot of an ended script."""
    rows = tuple(ServiceRow(health(FakeRobot(), *who), health_age=0.1) for who in operators)
    script = OperatorStatus(
        header=Header(boot=finished), script="s", step=1, steps=1, finished=bool(finished)
    )
    return Snapshot((), rows, task=task, plant=plant, operator=script)


class Watch:
    """Shows snapshots to :class:`OperatorArrivals`, a minute apart unless told otherwise."""

    def __init__(self) -> None:
        self.arrivals, self.now = OperatorArrivals(), 0.0

    def see(self, view: Snapshot, after: float = 60.0) -> Arrival:
        self.now += after
        return self.arrivals.decide(view, self.now)


def test_only_a_late_operator_gets_a_new_trial() -> None:
    running, over = task_status(), task_status(TaskVerdict.SUCCESS)
    new = Watch()
    assert new.see(with_operators(running, ("wbc", 1), ("sim", 1))).seed is None
    assert new.see(with_operators(running, ("wbc", 1), ("teleop", 1))).seed == 7
    assert new.see(with_operators(over, ("wbc", 1), ("teleop", 1))).seed is None
    assert new.see(with_operators(over, ("wbc", 2))).seed is None
    assert new.see(with_operators(over, ("teleop", 2))).seed == 8
    assert new.see(with_operators(over, ("teleop", 2), ("keyboard", 1))).seed is None
    assert new.see(with_operators(over, ("keyboard", 1))).seed is None

    early = Watch()
    assert early.see(with_operators(None, ("teleop", 1))) == Arrival()
    start = status(FakeRobot(), time=0.0)[1]
    assert isinstance(start, TaskStatus)
    assert early.see(with_operators(start, ("teleop", 1))).seed is None
    assert early.see(with_operators(running, ("teleop", 1))).seed is None
    assert early.see(with_operators(running, ("teleop", 2))).seed == 8


def test_a_stopped_robot_is_not_reset_and_it_is_said() -> None:
    running, new = task_status(), Watch()
    stopped = plant_status(guard=GuardMode.ESTOP, stopped_by="keyboard")
    arrival = new.see(with_operators(running, ("teleop", 1), plant=stopped))
    assert arrival.seed is None
    assert "stopped by keyboard" in arrival.text
    assert "trill resume" in arrival.text
    assert new.see(with_operators(running, ("teleop", 1), plant=stopped)) == Arrival()
    assert new.see(with_operators(running, ("teleop", 2), plant=plant_status())).seed == 7


def test_an_operator_that_crashed_goes_on_with_its_trial() -> None:
    running, new = task_status(), Watch()
    assert new.see(with_operators(running, ("teleop", 1))).seed == 7
    assert new.see(with_operators(running), 1.0) == Arrival()
    arrival = new.see(with_operators(running, ("teleop", 2)), REJOIN_TIME - 1.1)
    assert arrival.seed is None
    assert "teleop is back" in arrival.text
    assert new.see(with_operators(running), 1.0) == Arrival()
    assert new.see(with_operators(running, ("keyboard", 3)), 1.0).seed == 8


@pytest.mark.parametrize("what", ["late", "ended", "trial over"])
def test_an_operator_that_is_started_anew_gets_a_new_trial(what: str) -> None:
    running, new = task_status(), Watch()
    new.see(with_operators(running, ("teleop", 1)))
    if what == "ended":
        new.see(with_operators(running, ("teleop", 1), finished=1), 1.0)
    task = task_status(TaskVerdict.PARTIAL) if what == "trial over" else running
    new.see(with_operators(task), 0.1)
    after = REJOIN_TIME if what == "late" else 1.0
    assert new.see(with_operators(task, ("teleop", 2)), after).seed == 8
