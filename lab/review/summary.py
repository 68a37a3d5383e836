"""What happened in a run, computed from its log alone. Pure: messages in, :class:`RunSummary` out.

Numbers come from what the services said on the bus; only the verdict (why the run ended), the
environment and the logger's own drop counts are handed in.
"""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

from common.robot.pose import Pose2
from common.schemas import (
    ControllerState,
    Gait,
    GaitReply,
    GaitRequest,
    Message,
    OperatorStatus,
    PlantRequest,
    PlantState,
    PlantStatus,
    ServiceHealth,
    TaskStatus,
)
from common.topics import PLANT_TRUTH, Topic
from deploy.launch import Outcome
from lab.review.run_summary import GaitRun, GaitTally, RunSummary
from lab.review.scoring import GaitLedger, Track, commanded_motions
from lab.review.summary_readers import (
    LogFindings,
    PlantReader,
    ServiceReader,
    TopicReader,
    TrackingReader,
)
from lab.review.task_summary import TaskReader
from services.wbc.config import GaitConfig


def summarise(
    messages: Iterable[tuple[Topic[Any], Message]],
    *,
    outcome: Outcome = "completed",
    reason: str = "",
    environment: Mapping[str, str] | None = None,
    about_log: Callable[[], LogFindings] | None = None,
    commanded: Mapping[Gait, Pose2] | None = None,
) -> RunSummary:
    """Read a run's messages in the order they arrived and sum them up.

    Args:
        messages: (topic, message) pairs, e.g. from ``services.logger.read.reader``.
        outcome: why the run ended, as its supervisor saw it; a fall seen in the log overrules
            ``"completed"``, ``"script failed"`` and ``"unknown"``.
        reason: a sentence about ``outcome``.
        environment: versions and settings worth keeping with the numbers.
        about_log: what is known of the log itself once it is read; asked at the end.
        commanded: what each gait should do; by default as the controller's default configuration.
    """
    wanted = commanded_motions(GaitConfig()) if commanded is None else commanded
    seen = _Readers()
    for topic, message in messages:
        seen.read(topic, message)
    found = LogFindings() if about_log is None else about_log()
    runs, plant = seen.ledger.runs(wanted), seen.plant.tally()
    if plant.falls and outcome in {"completed", "script failed", "unknown"}:
        outcome, reason = "fell", reason or "the plant reported a fall"
    return RunSummary(
        outcome=outcome,
        reason=reason,
        duration=seen.plant.duration,
        gaits=_tally_gaits(runs),
        gait_runs=runs,
        walk=seen.ledger.walk(wanted),
        plant=plant,
        tracking=seen.tracking.tally(),
        trials=seen.task.tally(),
        services=seen.services.tally(),
        topics=seen.topics.tally(found),
        log_truncated=found.truncated,
        environment=dict(environment or {}),
    )


class _Readers:
    """Hands each message to who counts it."""

    def __init__(self) -> None:
        self.track, self.ledger = Track(), GaitLedger()
        self.plant, self.tracking = PlantReader(), TrackingReader()
        self.services, self.topics = ServiceReader(), TopicReader()
        self.task = TaskReader()

    def read(self, topic: Topic[Any], message: Message) -> None:
        self.topics.read(topic, message)
        match message:
            case PlantState() if topic.name == PLANT_TRUTH.name:
                self.track.add(message)
            case PlantState():
                self.plant.state(message)
            case PlantStatus():
                self.plant.status(message)
            case ControllerState():
                self.tracking.read(message)
            case ServiceHealth():
                self.services.read(message)
            case TaskStatus():
                self.task.status(message)
            case PlantRequest():
                self.task.request(message)
            case OperatorStatus():
                self.task.operator(message)
            case GaitRequest():
                self.ledger.request(message)
            case GaitReply():
                self.ledger.reply(message, self.track)


def _tally_gaits(runs: list[GaitRun]) -> dict[str, GaitTally]:
    """Counts by gait name; the entry ``total`` sums them."""
    names = sorted({run.gait for run in runs})
    tallies = {name: _tally([run for run in runs if run.gait == name]) for name in names}
    return {**tallies, "total": _tally(runs)}


def _tally(runs: list[GaitRun]) -> GaitTally:
    return GaitTally(
        requested=len(runs),
        accepted=sum(run.outcome in {"accepted", "completed", "aborted"} for run in runs),
        completed=sum(run.outcome == "completed" for run in runs),
        refused=sum(run.refusals for run in runs),
        aborted=sum(run.outcome == "aborted" for run in runs),
    )
