"""What became of a run's scored task: trial by trial, from the plant's own judge. Pure."""

from common.schemas import OperatorStatus, PlantRequest, TaskStatus
from lab.live.new_trials import preceded_first_operator
from lab.review.run_summary import ContactTally, StageTally, TaskTrial


class TaskReader:
    """Follows the task's status; a reset or a new life of the plant begins another trial."""

    def __init__(self) -> None:
        self._trials: list[_Trial] = []
        self._operator = ""

    def status(self, message: TaskStatus) -> None:
        """Take in the next status."""
        if not self._trials or not self._trials[-1].goes_on_with(message):
            self._trials.append(_Trial())
        self._trials[-1].take(message, self._operator)

    def operator(self, message: OperatorStatus) -> None:
        """Take in who is operating."""
        self._operator = message.script

    def request(self, message: PlantRequest) -> None:
        """Take in what was asked of the plant: a trial before the operator came is nobody's."""
        if self._trials:
            self._trials[-1].asked(message)

    def tally(self) -> list[TaskTrial]:
        """Trials in the order of time; of those that never began only the last."""
        real = [trial for trial in self._trials if not trial.idle]
        return [trial.tally() for trial in real if trial.began or trial is real[-1]]


class _Trial:
    def __init__(self) -> None:
        self.idle = False
        self._last: TaskStatus | None = None
        self._done: dict[str, float] = {}
        self._operator = ""

    @property
    def began(self) -> bool:
        """Whether its clock started."""
        return self._last is not None and self._last.time > 0.0

    def goes_on_with(self, message: TaskStatus) -> bool:
        """Whether ``message`` is of the same trial."""
        last = self._last
        return last is None or (
            (last.header.boot, last.reset_count) == (message.header.boot, message.reset_count)
        )

    def take(self, message: TaskStatus, operator: str) -> None:
        self._last, self._operator = message, operator or self._operator
        for stage in message.stages:
            if stage.done:
                self._done.setdefault(stage.name, message.time)

    def asked(self, request: PlantRequest) -> None:
        if self._last is not None and preceded_first_operator(request, self._last):
            self.idle = True

    def tally(self) -> TaskTrial:
        last = self._last
        assert last is not None
        return TaskTrial(
            task=last.task,
            seed=last.seed,
            verdict=last.verdict.name.lower(),
            time=last.time,
            limit=last.limit,
            reason=last.reason,
            stages=[StageTally(name=s.name, at=self._done.get(s.name)) for s in last.stages],
            undesired=[
                ContactTally(name=touch.name, since=touch.since, peak=touch.peak)
                for touch in last.undesired
            ],
            operator=self._operator,
        )


def trial_lines(trials: list[TaskTrial]) -> list[str]:
    """The trials for a person, line by line."""
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
        touches = ", ".join(
            f"{touch.name} at {touch.since:.1f} s (peak {touch.peak:.0f} N)"
            for touch in trial.undesired
        )
        lines.append(f"{'  undesired':<14} {touches or 'no contact'}")
    return lines


def _outcome(trial: TaskTrial) -> str:
    if trial.verdict == "running":
        return f"no verdict after {trial.time:.1f} of {trial.limit:g} s"
    return f"{trial.verdict.upper()} after {trial.time:.1f} of {trial.limit:g} s"
