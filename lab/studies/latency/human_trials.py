"""Reads a person's trials from a recorded log and measures them as the synthetic operator's."""

from collections.abc import Callable
from dataclasses import dataclass, field

from common.ports import OPERATORS
from common.schemas import PlantRequest, TaskStatus, TaskVerdict
from common.topics import CAMERA_LEFT, PLANT_STATE, TASK_STATUS
from lab.errors import LatencyStudyError
from lab.live.new_trials import preceded_first_operator
from lab.studies.latency.conditions import Condition
from lab.studies.latency.meter import TrialMeter, judged_values
from lab.studies.latency.record import StudyTrial
from services.logger.read.reader import LogReader

_FEEDBACK_INPUTS = [
    (service, topic.name) for topic in (CAMERA_LEFT, PLANT_STATE) for service in OPERATORS
]
"""Inputs by which an operator may see the robot, the likeliest first."""


@dataclass
class _Segment:
    """The part of a log between two resets of the plant.

    Attributes:
        unattended: whether it ended before the first operator came.
        meter: measures the trial.
        status: last status of the judge, the verdict once there is one.
    """

    unattended: bool = False
    meter: TrialMeter = field(default_factory=TrialMeter)
    status: TaskStatus | None = None

    @property
    def over(self) -> bool:
        return self.status is not None and self.status.verdict is not TaskVerdict.RUNNING

    def includes(self, status: TaskStatus) -> bool:
        """Whether ``status`` is of this segment: the plant was neither reset nor restarted."""
        last = self.status
        return last is None or (
            (last.header.boot, last.reset_count) == (status.header.boot, status.reset_count)
        )


def read_trials(
    log: LogReader,
    participant: str,
    condition: Condition,
    on_message: Callable[[], None] = lambda: None,
) -> list[StudyTrial]:
    """Return every judged trial of a log, except those before the first operator came.

    Args:
        log: the log.
        participant: pseudonym of the person.
        condition: condition under which the whole log was recorded.
        on_message: called after each message.

    Raises:
        LoggerError: the log cannot be read.
        LatencyStudyError: the log has no verdict.
    """
    segments = [_Segment()]
    for topic, message in log.messages():
        on_message()
        segment = segments[-1]
        if isinstance(message, TaskStatus):
            if not segment.includes(message):
                segments.append(segment := _Segment())
            if not segment.over:
                segment.status = message
        elif isinstance(message, PlantRequest):
            status = segment.status
            segment.unattended |= status is not None and preceded_first_operator(message, status)
        elif not segment.over:
            # Messages after the verdict are not part of the trial.
            segment.meter.add(topic, message)
    trials = [
        _trial(segment.meter, segment.status, participant, condition)
        for segment in segments
        if segment.status is not None and segment.over and not segment.unattended
    ]
    if not trials:
        raise LatencyStudyError(
            f"{log.path}: expected a trial that came to its end, got no verdict in "
            f"{TASK_STATUS.name}; record a scored task, e.g. trill up --task door/unlock"
        )
    return trials


def _trial(
    meter: TrialMeter, status: TaskStatus, participant: str, condition: Condition
) -> StudyTrial:
    return StudyTrial(
        operator="human",
        participant=participant,
        task=status.task,
        condition=condition.name,
        seed=status.seed,
        simulated=status.time,
        **judged_values(status),
        **meter.values(condition, _FEEDBACK_INPUTS),
    )
