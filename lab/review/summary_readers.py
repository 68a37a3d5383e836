"""Count one thing each of a run's messages: the plant, the hands, the services, the topics."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

import numpy as np

from common.schemas import (
    ControllerState,
    Message,
    PlantState,
    PlantStatus,
    ServiceHealth,
)
from common.topics import Topic
from common.wire.sequence import SequenceTracker
from lab.review.run_summary import (
    PlantTally,
    ServiceTiming,
    Spread,
    TopicTally,
    Tracking,
)


@dataclass(frozen=True)
class LogFindings:
    """What reading the log showed about the log itself; counts by topic name.

    ``dropped``: received by the logger but not written. ``refused``: not decodable by this
    version's schemas. ``truncated``: the logger was killed.
    """

    dropped: Mapping[str, int] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    truncated: bool = False


def spread(samples: Iterable[float]) -> Spread:
    """Median, 99th percentile and maximum; all zero without samples."""
    values = np.fromiter(samples, dtype=np.float64)
    if not len(values):
        return Spread()
    median, p99 = np.percentile(values, [50, 99])
    return Spread(
        samples=len(values), median=float(median), p99=float(p99), maximum=float(values.max())
    )


class PlantReader:
    """What the plant measured and reported of itself."""

    def __init__(self) -> None:
        self._first: PlantState | None = None
        self._last: PlantState | None = None
        self._statuses: list[PlantStatus] = []

    def state(self, message: PlantState) -> None:
        """Take in a measured state."""
        if self._first is None or _other_life(self._first, message):
            self._first = message
        self._last = message

    def status(self, message: PlantStatus) -> None:
        """Take in a report."""
        self._statuses.append(message)

    @property
    def duration(self) -> float:
        """Robot time covered since the plant was last started or reset [s]."""
        if self._first is None or self._last is None:
            return 0.0
        return (self._last.header.stamp - self._first.header.stamp) * 1e-9

    def tally(self) -> PlantTally:
        """All of it."""
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


class TrackingReader:
    """How well the controller followed."""

    def __init__(self) -> None:
        self._hand: list[float] = []
        self._rotation: list[float] = []
        self._dcm: list[float] = []
        self._solver = ""
        self._unsolved = 0

    def read(self, message: ControllerState) -> None:
        """Take in a state of the controller."""
        self._solver, self._unsolved = message.solver, message.unsolved
        self._dcm.append(1e3 * message.dcm_error)
        if message.setpoint_fresh:
            self._hand.extend(1e3 * message.hand_position_error)
            self._rotation.extend(np.degrees(message.hand_rotation_error))

    def tally(self) -> Tracking:
        """All of it."""
        return Tracking(
            hand_position_mm=spread(self._hand),
            hand_rotation_deg=spread(self._rotation),
            dcm_mm=spread(self._dcm),
            solver=self._solver,
            unsolved=self._unsolved,
        )


class ServiceReader:
    """Each service's health."""

    def __init__(self) -> None:
        self._health: dict[str, list[ServiceHealth]] = {}

    def read(self, message: ServiceHealth) -> None:
        """Take in a report."""
        self._health.setdefault(message.service, []).append(message)

    def tally(self) -> dict[str, ServiceTiming]:
        """Timing by service."""
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


class TopicReader:
    """Counts by topic name."""

    def __init__(self) -> None:
        self._count: dict[str, int] = {}
        self._span: dict[str, tuple[int, int]] = {}
        self._sources: dict[str, set[str]] = {}
        self._nominal: dict[str, float] = {}
        self._sequence: dict[str, SequenceTracker] = {}

    def read(self, topic: Topic[Any], message: Message) -> None:
        """Take in a message of any topic."""
        name, header = topic.name, message.header
        self._count[name] = self._count.get(name, 0) + 1
        self._nominal[name] = topic.rate
        first, last = self._span.get(name, (header.sent, header.sent))
        self._span[name] = (min(first, header.sent), max(last, header.sent))
        self._sources.setdefault(name, set()).add(header.source)
        self._sequence.setdefault(name, SequenceTracker()).observe(header)

    def tally(self, found: LogFindings) -> dict[str, TopicTally]:
        """Counts by topic; ``found`` adds what only the log's reader knows."""
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
