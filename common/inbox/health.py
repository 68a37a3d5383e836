"""Report the health of one input, as a service publishes it."""

from math import inf
from typing import Any

from common.inbox.buffer import TopicBuffer
from common.journal.journal import Journal
from common.schemas import LinkHealth

_STAGE_WINDOW_NS = 2_000_000_000


def health_of(buffer: TopicBuffer, now_ns: int, journal: Journal | None, link: str) -> LinkHealth:
    """Return an input's part of :class:`~common.schemas.ServiceHealth`.

    Args:
        buffer: the input.
        now_ns: time of the step.
        journal: source of the stages' durations; None: left out.
        link: what is injected in front of the input, in words.
    """
    age = buffer.age(now_ns)
    health = LinkHealth(
        topic=buffer.topic.name,
        received=buffer.received + buffer.queue.skipped,
        rate=buffer.rate(now_ns),
        age=-1.0 if age == inf else max(0.0, age),
        gaps=buffer.gaps,
        late=buffer.late,
        repeated=buffer.repeated,
        skipped=buffer.queue.skipped,
        stale=buffer.stale,
        adapted=buffer.adapted,
        foreign=buffer.foreign,
        refused=buffer.refused,
        last_refusal=buffer.last_refusal,
    )
    more: dict[str, Any] = {}
    if journal is not None:
        more["stages"] = journal.stages(buffer.topic.name, now_ns - _STAGE_WINDOW_NS)
    if buffer.queue.line is not None:
        stats = buffer.queue.line.stats()
        more |= {
            "link": link[:200],
            "requested_mean": stats.requested_mean,
            "requested_p99": stats.requested_p99,
            "achieved_mean": stats.achieved_mean,
            "achieved_p99": stats.achieved_p99,
            "lost": stats.lost,
        }
    return health.model_copy(update=more)
