"""Trials of a person out of a recorded log, judged as those of the synthetic operator."""

from collections.abc import Callable
from dataclasses import dataclass, field

from common.ports import OPERATORS
from common.schemas import (
    PlantRequest,
    PlantState,
    Setpoint,
    StepJournal,
    TaskStatus,
    TaskVerdict,
)
from common.topics import CAMERA_LEFT, JOURNAL, PLANT_STATE, TASK_STATUS, TELEOP_SETPOINT
from lab.errors import LatencyStudyError
from lab.live.new_trials import preceded_first_operator
from lab.studies.latency.conditions import COMMAND_INPUT, Condition
from lab.studies.latency.latencies import Input, Latencies
from lab.studies.latency.motion import Motion
from lab.studies.latency.row import TrialRow, judged, link_take
from services.logger.read.reader import LogReader

_SEEN = (CAMERA_LEFT.name, PLANT_STATE.name)
"""By what an operator sees, the likeliest first."""


@dataclass
class _Trial:
    """One life of the plant between resets; ``idle``: it passed before an operator came."""

    idle: bool = False
    latencies: Latencies = field(default_factory=Latencies)
    motion: Motion = field(default_factory=Motion)
    status: TaskStatus | None = None

    @property
    def over(self) -> bool:
        return self.status is not None and self.status.verdict is not TaskVerdict.RUNNING

    def goes_on_with(self, status: TaskStatus) -> bool:
        """Whether it is of the same trial: neither reset meanwhile nor started anew."""
        last = self.status
        return last is None or (
            (last.header.boot, last.reset_count) == (status.header.boot, status.reset_count)
        )


def trials_of(
    log: LogReader,
    participant: str,
    condition: Condition,
    progress: Callable[[], None] = lambda: None,
) -> list[TrialRow]:
    """Every trial of a log on which the judge has spoken, but those before an operator came.

    Args:
        log: to read through.
        participant: pseudonym of the person.
        condition: under which the whole log was recorded.
        progress: called with every message.

    Raises:
        LoggerError: the log cannot be read.
        LatencyStudyError: no trial in it came to its end.
    """
    trials: list[_Trial] = [_Trial()]
    for topic, message in log.messages():
        progress()
        now = trials[-1]
        if isinstance(message, TaskStatus):
            if not now.goes_on_with(message):
                trials.append(now := _Trial())
            if not now.over:
                now.status = message
        elif isinstance(message, PlantRequest):
            now.idle |= now.status is not None and preceded_first_operator(message, now.status)
        elif now.over:
            # What comes after the verdict is no part of the trial.
            continue
        elif isinstance(message, StepJournal) and topic is JOURNAL:
            now.latencies.add(message)
        elif isinstance(message, Setpoint) and topic is TELEOP_SETPOINT:
            now.motion.told(message)
        elif isinstance(message, PlantState) and topic is PLANT_STATE:
            now.motion.measured(message)
    rows = [
        _row(trial, participant, condition) for trial in trials if trial.over and not trial.idle
    ]
    if not rows:
        raise LatencyStudyError(
            f"{log.path}: expected a trial that came to its end, got no verdict in "
            f"{TASK_STATUS.name}; record a scored task, e.g. trill up --task door/unlock"
        )
    return rows


def _row(trial: _Trial, participant: str, condition: Condition) -> TrialRow:
    status = trial.status
    assert status is not None
    values = {
        "operator": "human",
        "participant": participant,
        "task": status.task,
        "condition": condition.name,
        "seed": status.seed,
        "verdict": status.verdict.name.lower(),
        "time": status.time,
        "limit": status.limit,
        "reason": status.reason,
        "command": link_take(trial.latencies, condition, COMMAND_INPUT),
        "feedback": link_take(trial.latencies, condition, _seen(trial.latencies)),
        "hand_path": trial.motion.hand_path,
        "arm_acceleration": trial.motion.arm_acceleration,
        "simulated": status.time,
    }
    return TrialRow.model_validate(values | judged(status))


def _seen(latencies: Latencies) -> Input:
    """What the operator saw by: the first of the usual inputs that took in something."""
    usual = [(service, topic) for topic in _SEEN for service in OPERATORS]
    return next((at for at in usual if latencies.of(*at)), usual[0])
