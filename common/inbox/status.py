"""How an input of a service is doing, as the service sees it and as its health message tells."""

from dataclasses import dataclass
from math import inf
from typing import Any

from common.inbox.buffer import TopicBuffer
from common.journal.journal import Journal
from common.schemas import LinkHealth

_ALIVE_PERIODS = 10.0
_RATE_TOLERANCE = 0.8
_STAGE_WINDOW_NS = 2_000_000_000


@dataclass(frozen=True)
class InputStatus:
    """Health of one input as of the current step; durations in seconds."""

    updated: bool
    """A good message was taken in this step."""
    alive: bool
    """Something arrived within ten nominal periods (for events: ever)."""
    fresh: bool
    """The last good message arrived within the topic's ``max_age``."""
    valid: bool
    """The last message that arrived was good."""
    rate_ok: bool
    """Arrivals come at 80 % of the nominal rate at least (for events: always)."""
    rate: float
    """Arrivals per second over the last second."""
    age: float
    """Since the last good message arrived; infinity before the first."""
    received: int
    gaps: int
    """Missing by sequence number, so far."""
    refused: int
    late: int
    """Arrived after a newer one of the same publisher; not shown for latest-value topics."""
    repeated: int
    """Arrived again; never shown twice."""
    skipped: int
    """Let go undecoded because the service did not come to read."""
    restarts: int
    """Times a publisher unknown so far appeared after the first."""
    stale: int
    """Too old when they arrived, not applied."""
    last_refusal: str


def age_of(slot: TopicBuffer, now_ns: int) -> float:
    """Seconds since the last good message arrived; infinity before the first."""
    return 1e-9 * (now_ns - slot.good_ns) if slot.value is not None else inf


def is_fresh(slot: TopicBuffer, now_ns: int) -> bool:
    """Whether the last good message arrived within the topic's ``max_age``."""
    return slot.value is not None and age_of(slot, now_ns) <= slot.topic.max_age


def status_of(slot: TopicBuffer, now_ns: int) -> InputStatus:
    """Everything known about an input at ``now_ns``."""
    topic = slot.topic
    rate = slot.rate(now_ns)
    silent = 1e-9 * (now_ns - slot.arrival_ns) if slot.received else inf
    return InputStatus(
        updated=slot.updated,
        alive=silent <= (_ALIVE_PERIODS / topic.rate if topic.rate else inf) and silent < inf,
        fresh=is_fresh(slot, now_ns),
        valid=slot.valid,
        rate_ok=rate >= _RATE_TOLERANCE * topic.rate,
        rate=rate,
        age=age_of(slot, now_ns),
        received=slot.received + slot.skipped,
        gaps=slot.gaps,
        refused=slot.refused,
        late=slot.late,
        repeated=slot.repeated,
        skipped=slot.skipped,
        restarts=slot.restarts,
        stale=slot.stale,
        last_refusal=slot.last_refusal,
    )


def health_of(slot: TopicBuffer, now_ns: int, journal: Journal | None, link: str) -> LinkHealth:
    """An input's part of :class:`~common.schemas.ServiceHealth`.

    Args:
        slot: the input.
        now_ns: time of the step.
        journal: knows where the time of the last messages went; None: not told.
        link: what is injected in front of it, in words.
    """
    age = age_of(slot, now_ns)
    health = LinkHealth(
        topic=slot.topic.name,
        received=slot.received + slot.skipped,
        rate=slot.rate(now_ns),
        age=-1.0 if age == inf else max(0.0, age),
        gaps=slot.gaps,
        late=slot.late,
        repeated=slot.repeated,
        skipped=slot.skipped,
        stale=slot.stale,
        refused=slot.refused,
        last_refusal=slot.last_refusal,
    )
    more: dict[str, Any] = {}
    if journal is not None:
        more["stages"] = journal.stages(slot.topic.name, now_ns - _STAGE_WINDOW_NS)
    if slot.line is not None:
        stats = slot.line.stats()
        more |= {
            "link": link[:200],
            "requested_mean": stats.requested_mean,
            "requested_p99": stats.requested_p99,
            "achieved_mean": stats.achieved_mean,
            "achieved_p99": stats.achieved_p99,
            "lost": stats.lost,
        }
    return health.model_copy(update=more)
