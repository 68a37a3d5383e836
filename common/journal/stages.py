"""Compute the time of messages in each stage of their way from sensor to result. Pure."""

from typing import Any

import numpy as np

from common.journal.tables import UNKNOWN, Table
from common.schemas import StageTime


def stage_durations(rows: Table) -> dict[str, Table]:
    """Compute the time each message spent in each stage of its way [ns].

    Args:
        rows: (n, 9) captured, sent, encode, arrival, injected, offset, decode, step's start,
            results sent [ns].

    Returns:
        (n,) by stage, in the order of the stages; ``wire`` and ``total`` only for messages with a
        known offset.
    """
    captured, sent, encode, arrival, injected, offset, decode, begun, used = rows.T
    known = offset != UNKNOWN
    return {
        "capture": sent - encode - captured,
        "encode": encode,
        "wire": (arrival - sent - offset)[known],
        "injected": injected,
        "queue": begun - arrival - injected,
        "decode": decode,
        "use": used - begun,
        "total": (used - captured - offset)[known],
    }


def stage_times(rows: Table) -> list[StageTime]:
    """Compute median and p99 of each stage.

    Args:
        rows: as for :func:`stage_durations`.

    Returns:
        the stages that any message has a duration for, in their order.
    """
    stages: dict[Any, Table] = dict(stage_durations(rows))
    return [StageTime(stage=name, **_spread(some)) for name, some in stages.items() if len(some)]


def _spread(durations: Table) -> dict[str, float]:
    ordered = np.sort(durations)
    last = len(ordered) - 1
    return {
        "median": 1e-9 * float(ordered[min(last, len(ordered) // 2)]),
        "p99": 1e-9 * float(ordered[min(last, int(0.99 * len(ordered)))]),
    }
