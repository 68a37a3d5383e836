"""The judge of a trial: a state machine over stages, failures and undesired contacts."""

from dataclasses import dataclass

from common.schemas import TaskVerdict
from services.sim.tasks.base import (
    ROBOT_PARTS,
    Contact,
    ContactPair,
    FailureCondition,
    Snapshot,
    Stage,
    Task,
)

CONTACT_FORCE = 1.0
"""Normal force below which a contact is not reported as undesired [N]."""


@dataclass(slots=True)
class Undesired:
    """Record of an undesired contact.

    Attributes:
        since: first time in the trial [s].
        peak: largest normal force [N].
    """

    since: float
    peak: float


class Judge:
    """Decides one trial of one task from snapshots; pure, without physics or bus.

    Attributes:
        task: the task.
        verdict: final unless RUNNING.
        reason: of the verdict; empty while running.
        time: of the last snapshot that counted [s].
        done: time at which each stage was done, by its name [s].
        undesired: undesired contacts in the order in which they happened.
    """

    def __init__(self, task: Task) -> None:
        self.task = task
        self.verdict = TaskVerdict.RUNNING
        self.reason = ""
        self.time = 0.0
        self.done: dict[str, float] = {}
        self.undesired: dict[Contact, Undesired] = {}
        self._true_since: dict[str, float] = {}

    @property
    def progress(self) -> tuple[TaskVerdict, int, int]:
        """Verdict, stages done and undesired contacts: what changes is worth a message."""
        return self.verdict, len(self.done), len(self.undesired)

    def tick(self, snapshot: Snapshot) -> TaskVerdict:
        """Judge the next snapshot and return the verdict; after a final one nothing changes."""
        if self.verdict is not TaskVerdict.RUNNING:
            return self.verdict
        self.time = snapshot.time
        self._record_contacts(snapshot)
        for stage in self.task.stages:
            if stage.name not in self.done and self._is_done(stage, snapshot):
                self.done[stage.name] = snapshot.time
        failure = next((f for f in self.task.failures if self._holds(f, snapshot)), None)
        if snapshot.fallen:
            self._end(TaskVerdict.FAILURE, "the robot fell")
        elif failure is not None:
            self._end(TaskVerdict.FAILURE, failure.name)
        elif self.task.stages[-1].name in self.done:
            self._end_at_goal()
        elif snapshot.time >= self.task.limit:
            self._end_at_time_limit()
        return self.verdict

    def _record_contacts(self, snapshot: Snapshot) -> None:
        for contact, force in snapshot.contacts.items():
            desired = ContactPair(contact.part, contact.object) in self.task.desired
            if desired or contact.part not in ROBOT_PARTS:
                continue
            if contact in self.undesired:
                self.undesired[contact].peak = max(self.undesired[contact].peak, force)
            elif force >= CONTACT_FORCE:
                self.undesired[contact] = Undesired(snapshot.time, force)

    def _is_done(self, stage: Stage, snapshot: Snapshot) -> bool:
        if stage.after and stage.after not in self.done:
            return False
        return self._holds(stage, snapshot)

    def _holds(self, item: Stage | FailureCondition, snapshot: Snapshot) -> bool:
        """Return whether the condition has been true without a break for its hold time."""
        if not item.test(snapshot):
            self._true_since.pop(item.name, None)
            return False
        since = self._true_since.setdefault(item.name, snapshot.time)
        return snapshot.time - since >= item.hold

    def _end_at_goal(self) -> None:
        if self.undesired:
            contacts = ", ".join(str(contact) for contact in self.undesired)
            self._end(TaskVerdict.PARTIAL, f"the goal was reached, but with {contacts}"[:400])
        else:
            self._end(TaskVerdict.SUCCESS, f"{self.task.stages[-1].name} in {self.time:.1f} s")

    def _end_at_time_limit(self) -> None:
        stages = self.task.stages
        parts = [stage.name for stage in stages if stage.partial and stage.name in self.done]
        missing = [stage.name for stage in stages if stage.name not in self.done]
        late = f"not within {self.task.limit:g} s: {', '.join(missing)}"
        if parts:
            self._end(TaskVerdict.PARTIAL, f"only {', '.join(parts)}; {late}")
        else:
            self._end(TaskVerdict.FAILURE, late)

    def _end(self, verdict: TaskVerdict, reason: str) -> None:
        self.verdict, self.reason = verdict, reason
