"""Compute the time of messages in each stage of their way from sensor to result. Pure."""

from typing import Any

import numpy as np

from common.journal.tables import UNKNOWN, Table
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
    last = len(durations) - 1
    median, p99 = min(last, len(durations) // 2), min(last, int(0.99 * len(durations)))
    ordered = np.partition(durations, (median, p99))
    return StageTime(
        stage=stage, median=1e-9 * float(ordered[median]), p99=1e-9 * float(ordered[p99])
    )
