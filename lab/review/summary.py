"""Compute the summary of a run from the messages of its log. Pure.

The verdict (why the run ended), the environment and the logger's own counts are not in the
messages and come from the caller; every other number is what the services published.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from common.operator.holds import HoldBook
from common.schemas import (
    AuthorityState,
    ControllerState,
    Estop,
    EstopClear,
    GaitReply,
    GaitRequest,
    Message,
    OperatorStatus,
    PlantRequest,
    PlantState,
    PlantStatus,
    ServiceHealth,
    StepJournal,
    TaskStatus,
)
from common.topics import PLANT_TRUTH, Topic
from deploy.launch import Outcome
from lab.review.run_summary import Event, GaitCounts, GaitRun, Intervention, RunSummary
from lab.review.scoring import GaitTracker
from lab.review.summary_readers import (
    LogFindings,
    PlantReader,
    ServiceReader,
    TopicReader,
    TrackingReader,
)
from lab.review.task_summary import TaskReader
from services.logger.read.events import EventLines


def summarise(
    messages: Iterable[tuple[Topic[Any], Message]],
    *,
    outcome: Outcome = "completed",
    reason: str = "",
    environment: Mapping[str, str] | None = None,
    about_log: Callable[[], LogFindings] = LogFindings,
) -> RunSummary:
    """Read a run's messages in order of arrival and sum them up.

    Args:
        messages: (topic, message) pairs, e.g. from ``services.logger.read.reader``.
        outcome: why the run ended, as its supervisor saw it; a fall in the log replaces
            ``"completed"``, ``"script failed"`` and ``"unknown"``.
        reason: a sentence about ``outcome``.
        environment: versions and settings to keep with the numbers.
        about_log: called after the last message for what reading showed about the log itself.
    """
    gaits, plant, tracking = GaitTracker(), PlantReader(), TrackingReader()
    services, topics, task = ServiceReader(), TopicReader(), TaskReader()
    events = _Events()
    for topic, message in messages:
        topics.read(topic, message)
        match message:
            case PlantState() if topic.name == PLANT_TRUTH.name:
                gaits.truth(message)
            case PlantState():
                plant.state(message)
            case PlantStatus():
                plant.status(message)
            case ControllerState():
                tracking.read(message)
            case ServiceHealth():
                services.read(message)
            case StepJournal():
                gaits.journal(message)
            case GaitRequest():
                gaits.request(message)
            case GaitReply():
                gaits.reply(message)
            case TaskStatus() | PlantRequest() | OperatorStatus():
                task.read(message)
        events.read(message, plant)
    found, runs, plant_stats = about_log(), gaits.runs(), plant.stats()
    if plant_stats.falls and outcome in {"completed", "script failed", "unknown"}:
        outcome, reason = "fell", reason or "the plant reported a fall"
    names = sorted({run.gait for run in runs})
    by_name = {name: [run for run in runs if run.gait == name] for name in names}
    return RunSummary(
        outcome=outcome,
        reason=reason,
        duration=plant.duration,
        gaits={name: _counts(some) for name, some in {**by_name, "total": runs}.items()},
        gait_runs=runs,
        walk=gaits.walk(),
        plant=plant_stats,
        tracking=tracking.stats(),
        trials=task.trials(),
        events=events.found,
        interventions=events.interventions(plant.duration),
        services=services.stats(),
        topics=topics.stats(found),
        log_truncated=found.truncated,
        log_remarks=list(found.remarks),
        environment=dict(environment or {}),
    )


class _Events:
    """Finds stops, their ends and changes of who has the robot."""

    def __init__(self) -> None:
        self.found: list[Event] = []
        self._lines = EventLines()
        self._book = HoldBook()

    def read(self, message: Message, plant: PlantReader) -> None:
        if isinstance(message, AuthorityState | Estop | EstopClear | PlantStatus):
            text, _ = self._lines.line(message)
            if text:
                self.found.append(Event(at=plant.duration, text=text))
        if isinstance(message, AuthorityState):
            self._book.observe(message, plant.duration)

    def interventions(self, now: float) -> list[Intervention]:
        """Return the interventions until ``now`` [s]."""
        return [
            Intervention(operator=one.name, at=one.start, length=one.length(now), until=one.until)
            for one in self._book.holds
            if one.intervention
        ]


def _counts(runs: list[GaitRun]) -> GaitCounts:
    return GaitCounts(
        requested=len(runs),
        accepted=sum(run.outcome in {"accepted", "completed", "aborted"} for run in runs),
        completed=sum(run.outcome == "completed" for run in runs),
        refused=sum(run.refusals for run in runs),
        aborted=sum(run.outcome == "aborted" for run in runs),
    )
