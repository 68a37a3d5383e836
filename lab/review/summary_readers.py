"""Accumulate the numbers of a summary message by message: plant, tracking, services, topics.

A service that is restarted counts from zero again: what it counts is added up over its lives, each
with a boot id of its own. Samples are kept as packed doubles, so that a log of hours fits in
memory.
"""

from array import array
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from common.order_statistics import Numbers
from common.schemas import (
    ControllerState,
    GuardMode,
    Header,
    Message,
    PlantState,
    PlantStatus,
    Sender,
    ServiceHealth,
)
from common.spool import Spool
from common.topics import Topic
from lab.review.run_summary import PlantStats, Quantiles, ServiceTiming, TopicStats, Tracking

_STATUSES_PER_SECOND = 10


def _samples() -> "array[float]":
    return array("d")


@dataclass(frozen=True)
class LogFindings:
    """What reading the log showed about the log itself.

    Attributes:
        lost: messages that were sent while the logger ran and never reached it, by topic name.
        dropped: messages that the logger received but did not write, by topic name.
        refused: messages that do not fit the schemas of this version, by topic name.
        truncated: whether the logger was killed.
        remarks: what else a reader should know, a sentence each.
    """

    lost: Mapping[str, int] = field(default_factory=dict)
    dropped: Mapping[str, int] = field(default_factory=dict)
    refused: Mapping[str, int] = field(default_factory=dict)
    truncated: bool = False
    remarks: Sequence[str] = ()


class PlantReader:
    """Accumulates the states that the plant measured and the statuses that it reported."""

    def __init__(self) -> None:
        self._spans: dict[tuple[int, int], tuple[Header, Header]] = {}
        """First and last state's header of each life and reset."""
        self._statuses: dict[int, PlantStatus] = {}
        """Last status of each life."""
        self._fallen = False
        self._falls = 0
        self._stops = 0
        self._latest: PlantStatus | None = None
        self._saturated, self._factors = _samples(), _samples()
        self._age_medians, self._age_p99s = _samples(), _samples()

    def state(self, message: PlantState) -> None:
        """Add a measured state."""
        epoch, header = (message.header.boot, message.reset_count), message.header
        first, _ = self._spans.get(epoch, (header, header))
        self._spans[epoch] = first, header

    def status(self, message: PlantStatus) -> None:
        """Add a report."""
        self._falls += message.fallen and not self._fallen
        self._fallen = message.fallen
        self._count_stops(message)
        self._statuses[message.header.boot] = message
        self._saturated.append(message.saturated_fraction)
        if not message.paused and message.real_time_factor > 0.0:
            self._factors.append(message.real_time_factor)
        if message.age_at_torque_median > 0.0:
            self._age_medians.append(1e3 * message.age_at_torque_median)
            self._age_p99s.append(1e3 * message.age_at_torque_p99)

    def _count_stops(self, message: PlantStatus) -> None:
        """Count a stop once, though a restarted plant keeps it and goes on with its number."""
        latest, self._latest = self._latest, message
        before = self._statuses.get(message.header.boot)
        if before is not None:
            self._stops += max(0, message.stops - before.stops)
        elif message.guard is GuardMode.ESTOP:
            self._stops += latest is None or latest.stops != message.stops

    @property
    def duration(self) -> float:
        """Robot time of all lives and resets [s]."""
        return 1e-9 * sum(last.stamp - first.stamp for first, last in self._spans.values())

    def stats(self) -> PlantStats:
        """Return the totals."""
        lives = list(self._statuses.values())
        if not lives:
            return PlantStats()
        resets: dict[int, int] = {}
        for boot, reset in self._spans:
            resets[boot] = max(reset, resets.get(boot, 0))
        age_p99 = Quantiles.of(self._age_p99s)
        return PlantStats(
            falls=self._falls,
            lives=len(lives),
            stops=self._stops,
            resets=sum(resets.values()),
            holds=sum(last.holds for last in lives),
            commands_applied=sum(last.commands_applied for last in lives),
            commands_refused=sum(last.commands_refused for last in lives),
            late_steps=sum(last.late_steps for last in lives),
            saturated_fraction=float(np.mean(self._saturated)),
            real_time_factor=self._real_time_factor(),
            # The factor is taken over a second, which is not full at first.
            real_time_factor_worst=min(self._factors[_STATUSES_PER_SECOND:], default=0.0),
            age_at_torque_median_ms=Quantiles.of(self._age_medians).median,
            age_at_torque_p99_ms=age_p99.median,
            age_at_torque_p99_worst_ms=age_p99.maximum,
        )

    def _real_time_factor(self) -> float:
        wall = 1e-9 * sum(last.sent - first.sent for first, last in self._spans.values())
        return self.duration / wall if wall > 0.0 else 0.0


class TrackingReader:
    """Accumulates the tracking errors of the controller."""

    def __init__(self) -> None:
        self._hands, self._dcm_mm = Spool(4, "d"), Spool(1, "d")
        """Of the left and the right hand: position [mm], rotation [deg]; of the DCM [mm]."""
        self._last: dict[int, ControllerState] = {}
        """Last state of each life."""

    def read(self, message: ControllerState) -> None:
        """Add a state of the controller; hands count only while their set-points are fresh."""
        self._last[message.header.boot] = message
        self._dcm_mm.extend((1e3 * message.dcm_error,))
        if message.setpoint_fresh:
            self._hands.extend((1e3 * message.hand_position_error).tolist())
            self._hands.extend(np.degrees(message.hand_rotation_error).tolist())

    def stats(self) -> Tracking:
        """Return the distributions."""
        return Tracking(
            hand_position_mm=self._of_hands(0),
            hand_rotation_deg=self._of_hands(2),
            dcm_mm=Quantiles.of_parts(partial(_numbers, self._dcm_mm, 0)),
            solver=next((last.solver for last in reversed(self._last.values())), ""),
            unsolved=sum(last.unsolved for last in self._last.values()),
        )

    def _of_hands(self, first: int) -> Quantiles:
        """Return the distribution over both hands, in columns ``first`` and the next."""
        return Quantiles.of_parts(partial(_numbers, self._hands, first, first + 1))


def _numbers(spool: Spool, *columns: int) -> Iterator[Numbers]:
    """Yield all numbers of some columns in parts."""
    for parts in spool.parts(*columns):
        yield from parts


@dataclass
class _Health:
    """Reports of one service; ``lives`` has the last one of each."""

    lives: dict[int, ServiceHealth] = field(default_factory=dict)
    medians: "array[float]" = field(default_factory=_samples)
    p99s: "array[float]" = field(default_factory=_samples)
    cpu: "array[float]" = field(default_factory=_samples)


class ServiceReader:
    """Accumulates each service's health reports."""

    def __init__(self) -> None:
        self._services: dict[str, _Health] = {}

    def read(self, message: ServiceHealth) -> None:
        """Add a report."""
        health = self._services.setdefault(message.service, _Health())
        health.lives[message.header.boot] = message
        health.medians.append(1e3 * message.step_median)
        health.p99s.append(1e3 * message.step_p99)
        health.cpu.append(message.cpu)

    def stats(self) -> dict[str, ServiceTiming]:
        """Return the timing of each service by name."""
        return {name: _timing(health) for name, health in sorted(self._services.items())}


def _timing(health: _Health) -> ServiceTiming:
    lives = list(health.lives.values())
    links = [link for life in lives for link in life.links]
    return ServiceTiming(
        period_ms=1e3 * lives[-1].period,
        steps=sum(life.steps for life in lives),
        deadline_misses=sum(life.deadline_misses for life in lives),
        step_median_ms=float(np.median(health.medians)),
        step_p99_ms=float(np.median(health.p99s)),
        step_p99_worst_ms=max(health.p99s),
        cpu=float(np.mean(health.cpu)),
        realtime=lives[-1].realtime,
        lives=len(lives),
        input_gaps=sum(link.gaps for link in links),
        input_refused=sum(link.refused for link in links),
    )


@dataclass
class _Sent:
    """Messages of one topic from one run of a publisher; times on its clock [ns]."""

    first: int
    last: int
    messages: int = 0


class TopicReader:
    """Counts messages by topic name."""

    def __init__(self) -> None:
        self._topics: dict[str, dict[Sender, _Sent]] = {}
        self._nominal: dict[str, float] = {}

    def read(self, topic: Topic[Any], message: Message) -> None:
        """Count a message."""
        header = message.header
        senders = self._topics.setdefault(topic.name, {})
        self._nominal[topic.name] = topic.rate
        sent = senders.get(header.sender)
        if sent is None:
            sent = senders[header.sender] = _Sent(header.sent, header.sent)
        sent.messages += 1
        sent.first, sent.last = min(sent.first, header.sent), max(sent.last, header.sent)

    def stats(self, found: LogFindings) -> dict[str, TopicStats]:
        """Return the counts by topic name; ``found`` adds those of messages not read here."""
        names = sorted({*self._topics, *found.lost, *found.dropped, *found.refused})
        return {name: self._stats(name, found) for name in names}

    def _stats(self, name: str, found: LogFindings) -> TopicStats:
        by_source: dict[str, list[_Sent]] = {}
        for sender, sent in self._topics.get(name, {}).items():
            by_source.setdefault(sender.source, []).append(sent)
        return TopicStats(
            messages=sum(sent.messages for lives in by_source.values() for sent in lives),
            rate=sum(_rate(lives) for lives in by_source.values()),
            nominal_rate=self._nominal.get(name, 0.0) * len(by_source),
            gaps=found.lost.get(name, 0),
            dropped=found.dropped.get(name, 0),
            undecodable=found.refused.get(name, 0),
        )


def _rate(lives: list[_Sent]) -> float:
    """Return the mean rate of a publisher while it ran [Hz]."""
    seconds = 1e-9 * sum(sent.last - sent.first for sent in lives)
    return sum(sent.messages - 1 for sent in lives) / seconds if seconds > 0.0 else 0.0
