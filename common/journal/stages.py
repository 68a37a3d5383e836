"""Compute the time of messages in each stage of their way from sensor to result. Pure."""

from typing import Any

import numpy as np

from common.journal.tables import UNKNOWN, Table
from common.order_statistics import Parts, order_statistics
from common.schemas import StageTime

STAGES = ("capture", "encode", "wire", "injected", "queue", "decode", "use", "total")


def stage_columns(rows: Table) -> dict[str, Table]:
    """Compute the time each message spent in each stage of its way [ns].

    Args:
        rows: (n, 9) captured, sent, encode, arrival, injected, offset, decode, step's start,
            results sent [ns].

    Returns:
        (n,) by stage, in the order of :data:`STAGES`; ``wire`` and ``total`` are :data:`UNKNOWN`
        for messages with an unknown offset.
    """
    captured, sent, encode, arrival, injected, offset, decode, begun, used = rows.T
    known = offset != UNKNOWN
    return {
        "capture": sent - encode - captured,
        "encode": encode,
        "wire": np.where(known, arrival - sent - offset, UNKNOWN),
        "injected": injected,
        "queue": begun - arrival - injected,
        "decode": decode,
        "use": used - begun,
        "total": np.where(known, used - captured - offset, UNKNOWN),
    }


def stage_times(rows: Table) -> list[StageTime]:
    """Compute median and p99 of each stage.

    Args:
        rows: as for :func:`stage_columns`.

    Returns:
        the stages that any message has a duration for, in their order.
    """
    times = (stage_time(name, some[some != UNKNOWN]) for name, some in stage_columns(rows).items())
    return [time for time in times if time is not None]


def stage_time(stage: Any, durations: Table) -> StageTime | None:
    """Return median and p99 of a stage's known ``durations`` (n,) [ns]; None without any."""
    if not len(durations):
        return None
    ranks = _ranks(len(durations))
    median, p99 = np.partition(durations, ranks)[list(ranks)].tolist()
    return StageTime(stage=stage, median=1e-9 * median, p99=1e-9 * p99)


def stage_time_of(stage: Any, durations: Parts) -> StageTime | None:
    """Return the same as :func:`stage_time` of durations that do not fit in memory."""
    count = sum(map(len, durations()))
    if not count:
        return None
    median, p99 = order_statistics(durations, _ranks(count))
    return StageTime(stage=stage, median=1e-9 * median, p99=1e-9 * p99)


def _ranks(count: int) -> tuple[int, int]:
    """Return where the median and the 99th percentile stand among sorted numbers."""
    return count // 2, int(0.99 * count)
