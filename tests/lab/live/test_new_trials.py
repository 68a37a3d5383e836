"""New trials for new operators."""

from common.schemas import TaskStatus, TaskVerdict
from lab.live.new_trials import OperatorArrivals
from lab.monitor.bus_stats import ServiceRow, Snapshot
from tests.lab.live.test_task_judge import task_status
from tests.lab.review.synthetic import FakeRobot
from tests.lab.review.synthetic_task import health, status


def with_operators(task: TaskStatus | None, *operators: tuple[str, int]) -> Snapshot:
    """A bus with these services, each with its boot id."""
    rows = tuple(ServiceRow(health(FakeRobot(), *who), health_age=0.1) for who in operators)
    return Snapshot((), rows, task=task)


def test_only_a_late_operator_gets_a_new_trial() -> None:
    running, over = task_status(), task_status(TaskVerdict.SUCCESS)
    new = OperatorArrivals()
    assert new.new_seed(with_operators(running, ("wbc", 1), ("sim", 1))) is None
    assert new.new_seed(with_operators(running, ("wbc", 1), ("teleop", 1))) == 7
    assert new.new_seed(with_operators(over, ("wbc", 1), ("teleop", 1))) is None
    assert new.new_seed(with_operators(over, ("wbc", 2))) is None
    assert new.new_seed(with_operators(over, ("teleop", 2))) == 8
    assert new.new_seed(with_operators(over, ("teleop", 2), ("keyboard", 1))) is None
    assert new.new_seed(with_operators(over, ("keyboard", 1))) is None

    early = OperatorArrivals()
    assert early.new_seed(with_operators(None, ("teleop", 1))) is None
    start = status(FakeRobot(), time=0.0)[1]
    assert isinstance(start, TaskStatus)
    assert early.new_seed(with_operators(start, ("teleop", 1))) is None
    assert early.new_seed(with_operators(running, ("teleop", 1))) is None
    assert early.new_seed(with_operators(running, ("teleop", 2))) == 8
