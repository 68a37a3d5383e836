"""Accumulate the numbers of a summary message by message: plant, tracking, services, topics.

Samples are kept as packed doubles, so that a log of hours fits in memory.
"""

from array import array
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.schemas import ControllerState, Message, PlantState, PlantStatus, ServiceHealth
from common.topics import Topic
from common.wire.sequence import SequenceTracker
from lab.review.run_summary import PlantStats, Quantiles, ServiceTiming, TopicStats, Tracking

_STATUSES_PER_SECOND = 10


def _samples() -> "array[float]":
    return array("d")


@dataclass(frozen=True)
class LogFindings:
    """What reading the log showed about the log itself.

    Attributes:
        dropped: messages that the logger received but did not write, by topic name.
        refused: messages that do not fit the schemas of this version, by topic name.
        truncated: whether the logger was killed.
    """

    dropped: Mapping[str, int] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    truncated: bool = False


class PlantReader:
    """Accumulates the states that the plant measured and the statuses that it reported."""

    def __init__(self) -> None:
        self._first: PlantState | None = None
        self._last: PlantState | None = None
        self._status: PlantStatus | None = None
        self._falls = 0
        self._saturated, self._factors = _samples(), _samples()
        self._age_medians, self._age_p99s = _samples(), _samples()

    def state(self, message: PlantState) -> None:
        """Add a measured state."""
        if self._first is None or _epoch(self._first) != _epoch(message):
            self._first = message
        self._last = message

    def status(self, message: PlantStatus) -> None:
        """Add a report."""
        self._falls += message.fallen and not (self._status and self._status.fallen)
        self._status = message
        self._saturated.append(message.saturated_fraction)
        if not message.paused and message.real_time_factor > 0.0:
            self._factors.append(message.real_time_factor)
        if message.age_at_torque_median > 0.0:
            self._age_medians.append(1e3 * message.age_at_torque_median)
            self._age_p99s.append(1e3 * message.age_at_torque_p99)

    @property
    def duration(self) -> float:
        """Robot time since the plant was last started or reset [s]."""
        if self._first is None or self._last is None:
            return 0.0
        return (self._last.header.stamp - self._first.header.stamp) * 1e-9

    def stats(self) -> PlantStats:
        """Return the totals."""
        last = self._status
        if last is None:
            return PlantStats()
        age_p99 = Quantiles.of(self._age_p99s)
        return PlantStats(
            falls=self._falls,
            resets=0 if self._last is None else self._last.reset_count,
            holds=last.holds,
            commands_applied=last.commands_applied,
            commands_refused=last.commands_refused,
            late_steps=last.late_steps,
            saturated_fraction=float(np.mean(self._saturated)),
            real_time_factor=self._real_time_factor(),
            # The factor is taken over a second, which is not full at first.
            real_time_factor_worst=min(self._factors[_STATUSES_PER_SECOND:], default=0.0),
            age_at_torque_median_ms=Quantiles.of(self._age_medians).median,
            age_at_torque_p99_ms=age_p99.median,
            age_at_torque_p99_worst_ms=age_p99.maximum,
        )

    def _real_time_factor(self) -> float:
        if self._first is None or self._last is None:
            return 0.0
        wall = (self._last.header.sent - self._first.header.sent) * 1e-9
        return self.duration / wall if wall > 0.0 else 0.0


def _epoch(state: PlantState) -> tuple[int, int]:
    """Return what changes when the plant is restarted or reset."""
    return state.header.boot, state.reset_count


class TrackingReader:
    """Accumulates the tracking errors of the controller."""

    def __init__(self) -> None:
        self._hand_mm, self._rotation_deg, self._dcm_mm = _samples(), _samples(), _samples()
        self._last: ControllerState | None = None

    def read(self, message: ControllerState) -> None:
        """Add a state of the controller; hands count only while their set-points are fresh."""
        self._last = message
        self._dcm_mm.append(1e3 * message.dcm_error)
        if message.setpoint_fresh:
            self._hand_mm.extend(1e3 * message.hand_position_error)
            self._rotation_deg.extend(np.degrees(message.hand_rotation_error))

    def stats(self) -> Tracking:
        """Return the distributions."""
        return Tracking(
            hand_position_mm=Quantiles.of(self._hand_mm),
            hand_rotation_deg=Quantiles.of(self._rotation_deg),
            dcm_mm=Quantiles.of(self._dcm_mm),
            solver=self._last.solver if self._last else "",
            unsolved=self._last.unsolved if self._last else 0,
        )


@dataclass
class _Health:
    """Reports of one service."""

    last: ServiceHealth
    medians: "array[float]" = field(default_factory=_samples)
    p99s: "array[float]" = field(default_factory=_samples)
    cpu: "array[float]" = field(default_factory=_samples)


class ServiceReader:
    """Accumulates each service's health reports."""

    def __init__(self) -> None:
        self._services: dict[str, _Health] = {}

    def read(self, message: ServiceHealth) -> None:
        """Add a report."""
        health = self._services.setdefault(message.service, _Health(message))
        health.last = message
        health.medians.append(1e3 * message.step_median)
        health.p99s.append(1e3 * message.step_p99)
        health.cpu.append(message.cpu)

    def stats(self) -> dict[str, ServiceTiming]:
        """Return the timing of each service by name."""
        return {
            name: ServiceTiming(
                period_ms=1e3 * health.last.period,
                steps=health.last.steps,
                deadline_misses=health.last.deadline_misses,
                step_median_ms=float(np.median(health.medians)),
                step_p99_ms=float(np.median(health.p99s)),
                step_p99_worst_ms=max(health.p99s),
                cpu=float(np.mean(health.cpu)),
                realtime=health.last.realtime,
                input_gaps=sum(link.gaps for link in health.last.links),
                input_refused=sum(link.refused for link in health.last.links),
            )
            for name, health in sorted(self._services.items())
        }


@dataclass
class _TopicCounts:
    """Messages of one topic."""

    nominal_rate: float = 0.0
    messages: int = 0
    first_sent: int = 0
    last_sent: int = 0
    sources: set[str] = field(default_factory=set)
    sequence: SequenceTracker = field(default_factory=SequenceTracker)

    @property
    def rate(self) -> float:
        """Mean rate [Hz]."""
        seconds = (self.last_sent - self.first_sent) * 1e-9
        return (self.messages - 1) / seconds if seconds > 0.0 else 0.0


class TopicReader:
    """Counts messages by topic name."""

    def __init__(self) -> None:
        self._topics: dict[str, _TopicCounts] = {}

    def read(self, topic: Topic[Any], message: Message) -> None:
        """Count a message."""
        header = message.header
        counts = self._topics.get(topic.name)
        if counts is None:
            counts = _TopicCounts(topic.rate, first_sent=header.sent, last_sent=header.sent)
            self._topics[topic.name] = counts
        counts.messages += 1
        counts.first_sent = min(counts.first_sent, header.sent)
        counts.last_sent = max(counts.last_sent, header.sent)
        counts.sources.add(header.source)
        counts.sequence.observe(header)

    def stats(self, found: LogFindings) -> dict[str, TopicStats]:
        """Return the counts by topic name; ``found`` adds those of messages not read here."""
        names = sorted({*self._topics, *found.dropped, *found.refused})
        known = {name: self._topics.get(name, _TopicCounts()) for name in names}
        return {
            name: TopicStats(
                messages=counts.messages,
                rate=counts.rate,
                nominal_rate=counts.nominal_rate * len(counts.sources),
                gaps=counts.sequence.missing,
                dropped=found.dropped.get(name, 0),
                undecodable=found.refused.get(name, 0),
            )
            for name, counts in known.items()
        }
