"""What happened in a run, computed from its log alone. Pure: messages in, :class:`RunSummary` out.

Numbers come from what the services said on the bus; only the verdict (why the run ended), the
environment and the logger's own drop counts are handed in.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from common.bus.sequence import SequenceTracker
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
from deploy.run_summary import (
    GaitRun,
    GaitTally,
    Outcome,
    PlantTally,
    RunSummary,
    ServiceTiming,
    Spread,
    TopicTally,
    Tracking,
)
from deploy.scoring import GaitLedger, Pose2, Track, commanded_motions
from deploy.task_summary import TaskReader
from services.wbc.config import GaitConfig


@dataclass(frozen=True)
class LogFindings:
    """What reading the log showed about the log itself; counts by topic name.

    ``dropped``: received by the logger but not written. ``refused``: not decodable by this
    version's schemas. ``truncated``: the logger was killed.
    """

    dropped: Mapping[str, int] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    truncated: bool = False


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
        messages: (topic, message) pairs, e.g. from ``services.logger.reader``.
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
        self.plant, self.tracking = _PlantReader(), _TrackingReader()
        self.services, self.topics = _ServiceReader(), _TopicReader()
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


def spread(samples: Iterable[float]) -> Spread:
    """Median, 99th percentile and maximum; all zero without samples."""
    values = np.fromiter(samples, dtype=np.float64)
    if not len(values):
        return Spread()
    median, p99 = np.percentile(values, [50, 99])
    return Spread(
        samples=len(values), median=float(median), p99=float(p99), maximum=float(values.max())
    )


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


class _PlantReader:
    def __init__(self) -> None:
        self._first: PlantState | None = None
        self._last: PlantState | None = None
        self._statuses: list[PlantStatus] = []

    def state(self, message: PlantState) -> None:
        if self._first is None or _other_life(self._first, message):
            self._first = message
        self._last = message

    def status(self, message: PlantStatus) -> None:
        self._statuses.append(message)

    @property
    def duration(self) -> float:
        """Robot time covered since the plant was last started or reset [s]."""
        if self._first is None or self._last is None:
            return 0.0
        return (self._last.header.stamp - self._first.header.stamp) * 1e-9

    def tally(self) -> PlantTally:
        if not self._statuses:
            return PlantTally()
        statuses, last = self._statuses, self._statuses[-1]
        # The first second has no full window behind it.
        paced = [s for s in statuses if not s.paused and s.real_time_factor > 0.0][10:]
        aged = [s for s in statuses if s.age_at_torque_median > 0.0]
        p99 = spread(1e3 * s.age_at_torque_p99 for s in aged)
        fallen = [False, *(s.fallen for s in statuses)]
        return PlantTally(
            falls=sum(now and not before for before, now in pairwise(fallen)),
            resets=0 if self._last is None else self._last.reset_count,
            holds=last.holds,
            commands_applied=last.commands_applied,
            commands_refused=last.commands_refused,
            late_steps=last.late_steps,
            saturated_fraction=float(np.mean([s.saturated_fraction for s in statuses])),
            real_time_factor=self._real_time_factor(),
            real_time_factor_worst=min((s.real_time_factor for s in paced), default=0.0),
            age_at_torque_median_ms=spread(1e3 * s.age_at_torque_median for s in aged).median,
            age_at_torque_p99_ms=p99.median,
            age_at_torque_p99_worst_ms=p99.maximum,
        )

    def _real_time_factor(self) -> float:
        if self._first is None or self._last is None:
            return 0.0
        wall = (self._last.header.sent - self._first.header.sent) * 1e-9
        return self.duration / wall if wall > 0.0 else 0.0


def _other_life(one: PlantState, other: PlantState) -> bool:
    return one.header.boot != other.header.boot or one.reset_count != other.reset_count


class _TrackingReader:
    def __init__(self) -> None:
        self._hand: list[float] = []
        self._rotation: list[float] = []
        self._dcm: list[float] = []
        self._solver = ""
        self._unsolved = 0

    def read(self, message: ControllerState) -> None:
        self._solver, self._unsolved = message.solver, message.unsolved
        self._dcm.append(1e3 * message.dcm_error)
        if message.setpoint_fresh:
            self._hand.extend(1e3 * message.hand_position_error)
            self._rotation.extend(np.degrees(message.hand_rotation_error))

    def tally(self) -> Tracking:
        return Tracking(
            hand_position_mm=spread(self._hand),
            hand_rotation_deg=spread(self._rotation),
            dcm_mm=spread(self._dcm),
            solver=self._solver,
            unsolved=self._unsolved,
        )


class _ServiceReader:
    def __init__(self) -> None:
        self._health: dict[str, list[ServiceHealth]] = {}

    def read(self, message: ServiceHealth) -> None:
        self._health.setdefault(message.service, []).append(message)

    def tally(self) -> dict[str, ServiceTiming]:
        return {name: _timing(reports) for name, reports in sorted(self._health.items())}


def _timing(reports: list[ServiceHealth]) -> ServiceTiming:
    last = reports[-1]
    return ServiceTiming(
        period_ms=1e3 * last.period,
        steps=last.steps,
        deadline_misses=last.deadline_misses,
        step_median_ms=1e3 * float(np.median([r.step_median for r in reports])),
        step_p99_ms=1e3 * float(np.median([r.step_p99 for r in reports])),
        step_p99_worst_ms=1e3 * max(r.step_p99 for r in reports),
        cpu=float(np.mean([r.cpu for r in reports])),
        realtime=last.realtime,
        input_gaps=sum(link.gaps for link in last.links),
        input_refused=sum(link.refused for link in last.links),
    )


class _TopicReader:
    """Counts by topic name."""

    def __init__(self) -> None:
        self._count: dict[str, int] = {}
        self._span: dict[str, tuple[int, int]] = {}
        self._sources: dict[str, set[str]] = {}
        self._nominal: dict[str, float] = {}
        self._sequence: dict[str, SequenceTracker] = {}

    def read(self, topic: Topic[Any], message: Message) -> None:
        name, header = topic.name, message.header
        self._count[name] = self._count.get(name, 0) + 1
        self._nominal[name] = topic.rate
        first, last = self._span.get(name, (header.sent, header.sent))
        self._span[name] = (min(first, header.sent), max(last, header.sent))
        self._sources.setdefault(name, set()).add(header.source)
        self._sequence.setdefault(name, SequenceTracker()).observe(header)

    def tally(self, found: LogFindings) -> dict[str, TopicTally]:
        return {
            name: TopicTally(
                messages=self._count.get(name, 0),
                rate=self._rate(name),
                nominal_rate=self._nominal.get(name, 0.0) * len(self._sources.get(name, {""})),
                gaps=self._sequence[name].missing if name in self._sequence else 0,
                dropped=found.dropped.get(name, 0),
                undecodable=found.refused.get(name, 0),
            )
            for name in sorted({*self._count, *found.dropped, *found.refused})
        }

    def _rate(self, name: str) -> float:
        first, last = self._span.get(name, (0, 0))
        return (self._count[name] - 1) / ((last - first) * 1e-9) if last > first else 0.0
