"""Decide when the live run of a scored task is over and why. Pure."""

from collections.abc import Sequence
from typing import Final

from common.schemas import TaskStatus, TaskVerdict
from deploy.launch import Outcome, Verdict
from deploy.process import Exit
from lab.monitor.bus_stats import Snapshot

AFTERMATH: Final = 1.5
"""Time for which a verdict is shown before everything is stopped [s]."""
VERDICT_TIMEOUT: Final = 6.0
"""Time that the judge in the plant has for its verdict after the operator's end [s]."""
_OUTCOMES: dict[TaskVerdict, Outcome] = {
    TaskVerdict.SUCCESS: "completed",
    TaskVerdict.PARTIAL: "partial success",
    TaskVerdict.FAILURE: "task failed",
}


class TaskJudge:
    """Waits for the verdict of the judge in the plant, also after the operator's end.

    The operator should run with ``--stay``, so that it holds its pose until everything is stopped.
    """

    def __init__(self, operator: str, seconds: float | None, timeout: float) -> None:
        """Judge a run whose operator is the process ``operator``."""
        self._operator = operator
        self._seconds = seconds
        self._timeout = timeout
        self._began_at: float | None = None
        self._verdict_at: float | None = None
        self._operator_ended_at: float | None = None
        self._operator_end = ""

    def verdict(self, elapsed: float, view: Snapshot, exits: Sequence[Exit]) -> Verdict | None:
        """Return the verdict, or None while the run goes on; ``elapsed`` since the start [s]."""
        if self._began_at is None and view.control is not None:
            self._began_at = elapsed
        for ended in exits:
            if ended.name == self._operator:
                reason = "the operator ended" if ended.expected else ended.describe()
                self._operator_ended(elapsed, reason)
            elif ended.essential and not ended.restarted:
                return Verdict("service died", ended.describe())
        task, operator = view.task, view.operator
        if task is not None and task.verdict is not TaskVerdict.RUNNING:
            fallen = view.plant is not None and view.plant.fallen
            return self._task_verdict(elapsed, task, fallen=fallen)
        if operator is not None and operator.finished:
            gave_up = f"the operator gave up: {operator.failed}" if operator.failed else ""
            self._operator_ended(elapsed, gave_up or "the operator ended")
        ended_at = self._operator_ended_at
        if ended_at is not None and elapsed >= ended_at + VERDICT_TIMEOUT:
            return Verdict("task failed", f"{self._operator_end}; {_state(task)}")
        lasted = 0.0 if self._began_at is None else elapsed - self._began_at
        if self._seconds is not None and lasted >= self._seconds:
            return Verdict("timed out", f"stopped after {self._seconds:g} s; {_state(task)}")
        if elapsed >= self._timeout:
            return Verdict("timed out", f"not done after {self._timeout:g} s; {_state(task)}")
        return None

    def _operator_ended(self, elapsed: float, reason: str) -> None:
        """Note when and why the operator ended, the first time."""
        if self._operator_ended_at is None:
            self._operator_ended_at, self._operator_end = elapsed, reason

    def _task_verdict(self, elapsed: float, task: TaskStatus, *, fallen: bool) -> Verdict | None:
        if self._verdict_at is None:
            self._verdict_at = elapsed
        if elapsed < self._verdict_at + AFTERMATH:
            return None
        outcome = _OUTCOMES[task.verdict]
        if fallen and task.verdict is TaskVerdict.FAILURE:
            outcome = "fell"
        return Verdict(outcome, f"{task.task} seed {task.seed}: {task.reason}")


def _state(task: TaskStatus | None) -> str:
    if task is None:
        return "no task status from the plant"
    done = [stage.name for stage in task.stages if stage.done]
    return f"no verdict at {task.time:.1f} s of the task, done: {', '.join(done) or 'nothing'}"
