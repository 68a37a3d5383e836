"""The judge of a trial: a small state machine over stages, mishaps and undesired contacts."""

from dataclasses import dataclass

from common.schemas import TaskVerdict
from services.sim.tasks.base import (
    ROBOT_PARTS,
    FailureCondition,
    Pair,
    Snapshot,
    Stage,
    Task,
    Touch,
)

TOUCH_FORCE = 1.0
"""A touch with less normal force is no collision [N]."""


@dataclass(slots=True)
class Undesired:
    """A contact that should not have been: first seen [s], largest normal force [N]."""

    since: float
    peak: float


class Judge:
    """Judges one trial of one task from a snapshot a tick; knows neither physics nor bus.

    Attributes:
        task: the task.
        verdict: as of the last snapshot; all but RUNNING are final.
        reason: why; empty while running.
        time: of the last snapshot that was judged [s].
        done: names of the stages done.
        undesired: contacts that should not have been, in the order they happened.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.verdict = TaskVerdict.RUNNING
        self.reason = ""
        self.time = 0.0
        self.done: dict[str, float] = {}
        self.undesired: dict[Touch, Undesired] = {}
        self._since: dict[str, float] = {}

    def tick(self, snapshot: Snapshot) -> TaskVerdict:
        """Take in what is now; returns the verdict."""
        if self.verdict is not TaskVerdict.RUNNING:
            return self.verdict
        self.time = snapshot.time
        self._note_contacts(snapshot)
        for stage in self.task.stages:
            if stage.name not in self.done and self._is_done(stage, snapshot):
                self.done[stage.name] = snapshot.time
        wrong = next((item for item in self.task.wrongs if self._happened(item, snapshot)), None)
        if snapshot.fallen:
            self._end(TaskVerdict.FAILURE, "the robot fell")
        elif wrong is not None:
            self._end(TaskVerdict.FAILURE, wrong.name)
        elif self.task.stages[-1].name in self.done:
            self._reached()
        elif snapshot.time >= self.task.limit:
            self._time_out()
        return self.verdict

    def _note_contacts(self, snapshot: Snapshot) -> None:
        for touch, force in snapshot.touches.items():
            if touch.part not in ROBOT_PARTS or Pair(touch.part, touch.thing) in self.task.desired:
                continue
            if touch in self.undesired:
                self.undesired[touch].peak = max(self.undesired[touch].peak, force)
            elif force >= TOUCH_FORCE:
                self.undesired[touch] = Undesired(snapshot.time, force)

    def _is_done(self, stage: Stage, snapshot: Snapshot) -> bool:
        if stage.after and stage.after not in self.done:
            return False
        return self._lasts(stage, snapshot)

    def _happened(self, wrong: FailureCondition, snapshot: Snapshot) -> bool:
        return self._lasts(wrong, snapshot)

    def _lasts(self, item: Stage | FailureCondition, snapshot: Snapshot) -> bool:
        """Whether ``item``'s test has been true without a break for as long as it asks."""
        if not item.test(snapshot):
            self._since.pop(item.name, None)
            return False
        return snapshot.time - self._since.setdefault(item.name, snapshot.time) >= item.hold

    def _reached(self) -> None:
        if self.undesired:
            touches = ", ".join(str(touch) for touch in self.undesired)
            self._end(TaskVerdict.PARTIAL, f"the goal was reached, but with {touches}"[:400])
        else:
            self._end(TaskVerdict.SUCCESS, f"{self.task.stages[-1].name} in {self.time:.1f} s")

    def _time_out(self) -> None:
        parts = [
            stage.name for stage in self.task.stages if stage.counts and stage.name in self.done
        ]
        missing = [stage.name for stage in self.task.stages if stage.name not in self.done]
        late = f"not within {self.task.limit:g} s: {', '.join(missing)}"
        if parts:
            self._end(TaskVerdict.PARTIAL, f"only {', '.join(parts)}; {late}")
        else:
            self._end(TaskVerdict.FAILURE, late)

    def _end(self, verdict: TaskVerdict, reason: str) -> None:
        self.verdict, self.reason = verdict, reason
