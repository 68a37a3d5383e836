"""Sum up the trials of a run's scored task from the statuses of the judge in the plant. Pure."""

from dataclasses import dataclass, field

from common.schemas import OperatorStatus, PlantRequest, TaskStatus
from lab.live.new_trials import preceded_first_operator
from lab.review.run_summary import StageResult, TaskTrial
from lab.review.timeline import trial_of


@dataclass
class _Trial:
    last: TaskStatus
    operator: str = ""
    done_at: dict[str, float] = field(default_factory=dict)
    """Trial time at which each stage was done [s]."""
    attended: bool = True
    """Whether it did not pass before an operator came."""

    def result(self) -> TaskTrial:
        last = self.last
        return TaskTrial(
            task=last.task,
            seed=last.seed,
            verdict=last.verdict.name.lower(),
            time=last.time,
            limit=last.limit,
            reason=last.reason,
            stages=[StageResult(name=s.name, at=self.done_at.get(s.name)) for s in last.stages],
            undesired=last.undesired,
            operator=self.operator,
        )


class TaskReader:
    """Collects the trials of a scored task; each reset or restart of the plant begins one."""

    def __init__(self) -> None:
        self._trials: dict[tuple[int, int], _Trial] = {}
        self._latest: _Trial | None = None
        self._operator = ""

    def read(self, message: TaskStatus | PlantRequest | OperatorStatus) -> None:
        """Add the next message."""
        if isinstance(message, OperatorStatus):
            self._operator = message.script
        elif isinstance(message, TaskStatus):
            self._latest = trial = self._trials.setdefault(trial_of(message), _Trial(message))
            trial.last = message
            trial.operator = self._operator or trial.operator
            for stage in message.stages:
                if stage.done:
                    trial.done_at.setdefault(stage.name, message.time)
        elif self._latest and preceded_first_operator(message, self._latest.last):
            self._latest.attended = False

    def trials(self) -> list[TaskTrial]:
        """Return the trials in order of time; of those whose clock never ran only the last."""
        attended = [trial for trial in self._trials.values() if trial.attended]
        return [t.result() for t in attended if t.last.time > 0.0 or t is attended[-1]]


def trial_lines(trials: list[TaskTrial]) -> list[str]:
    """Format the trials for a person, three lines each."""
    lines = []
    for trial in trials:
        by = f" by {trial.operator}" if trial.operator else ""
        lines.append(
            f"{'task':<14} {trial.task} seed {trial.seed}{by}: {_outcome(trial)}"
            + (f": {trial.reason}" if trial.reason else "")
        )
        stages = ", ".join(
            f"{stage.name} {'-' if stage.at is None else f'{stage.at:.1f} s'}"
            for stage in trial.stages
        )
        lines.append(f"{'  stages':<14} {stages}")
        contacts = ", ".join(
            f"{contact.name} at {contact.since:.1f} s (peak {contact.peak:.0f} N)"
            for contact in trial.undesired
        )
        lines.append(f"{'  undesired':<14} {contacts or 'no contact'}")
    return lines


def _outcome(trial: TaskTrial) -> str:
    verdict = "no verdict" if trial.verdict == "running" else trial.verdict.upper()
    return f"{verdict} after {trial.time:.1f} of {trial.limit:g} s"
