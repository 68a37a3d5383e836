"""Decides when a live run of a scored task is over and why. Pure."""

from collections.abc import Sequence
from typing import Final

from common.schemas import TaskStatus, TaskVerdict
from deploy.launch import Outcome, Verdict
from deploy.process import Exit
from lab.monitor.bus_stats import Snapshot

AFTERMATH: Final = 1.5
"""How long a verdict is watched before everything stops [s]."""
PATIENCE: Final = 6.0
"""How long the plant's judge has to speak once the operator has done, or has given up [s]."""
_OUTCOMES: dict[TaskVerdict, Outcome] = {
    TaskVerdict.SUCCESS: "completed",
    TaskVerdict.PARTIAL: "partial success",
    TaskVerdict.FAILURE: "task failed",
}


class TaskJudge:
    """Waits for the verdict of the task's judge in the plant; an operator that ends is not one.

    The operator is expected to stay (``--stay``), so that it holds on until everything stops.
    """

    def __init__(self, operator: str, seconds: float | None, timeout: float) -> None:
        """Judge a run whose operator is the process ``operator``."""
        self._operator = operator
        self._seconds = seconds
        self._timeout = timeout
        self._began_at: float | None = None
        self._spoken_at: float | None = None
        self._ended_at: float | None = None
        self._ended = ""

    def verdict(
        self, elapsed: float, view: Snapshot, exits: Sequence[tuple[Exit, bool]]
    ) -> Verdict | None:
        """The verdict, or None while the run goes on.

        Args:
            elapsed: since the start [s].
            view: the bus as last seen.
            exits: processes that just ended, each with whether it was essential.
        """
        if self._began_at is None and view.control is not None:
            self._began_at = elapsed
        for ended, essential in exits:
            if ended.name == self._operator:
                self._over(elapsed, "the operator was done" if ended.expected else ended.describe())
            elif essential and not ended.restarted:
                return Verdict("service died", ended.describe())
        task, operator = view.task, view.operator
        if task is not None and task.verdict is not TaskVerdict.RUNNING:
            return self._spoken(elapsed, task, fallen=view.plant is not None and view.plant.fallen)
        if operator is not None and operator.finished:
            gave_up = f"the operator gave up: {operator.failed}" if operator.failed else ""
            self._over(elapsed, gave_up or "the operator was done")
        if self._ended_at is not None and elapsed >= self._ended_at + PATIENCE:
            return Verdict("task failed", f"{self._ended}; {_standing(task)}")
        lasted = 0.0 if self._began_at is None else elapsed - self._began_at
        if self._seconds is not None and lasted >= self._seconds:
            return Verdict("timed out", f"stopped after {self._seconds:g} s; {_standing(task)}")
        if elapsed >= self._timeout:
            return Verdict("timed out", f"not done after {self._timeout:g} s; {_standing(task)}")
        return None

    def _over(self, elapsed: float, why: str) -> None:
        """The operator does no more."""
        if self._ended_at is None:
            self._ended_at, self._ended = elapsed, why

    def _spoken(self, elapsed: float, task: TaskStatus, *, fallen: bool) -> Verdict | None:
        if self._spoken_at is None:
            self._spoken_at = elapsed
        if elapsed < self._spoken_at + AFTERMATH:
            return None
        outcome = _OUTCOMES[task.verdict]
        if fallen and task.verdict is TaskVerdict.FAILURE:
            outcome = "fell"
        return Verdict(outcome, f"{task.task} seed {task.seed}: {task.reason}")


def _standing(task: TaskStatus | None) -> str:
    if task is None:
        return "the plant said nothing of a task"
    done = [stage.name for stage in task.stages if stage.done]
    return f"no verdict at {task.time:.1f} s of the task, done: {', '.join(done) or 'nothing'}"
