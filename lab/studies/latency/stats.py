"""The statistics of the study; pure."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from math import sqrt
from statistics import NormalDist

import numpy as np

from lab.studies.latency.row import Operator, TrialRow

CONFIDENCE = 0.95
_Z = NormalDist().inv_cdf(0.5 + 0.5 * CONFIDENCE)
_RESAMPLES = 10_000
_SEED = 20_231
"""Of the bootstrap: the same trials give the same intervals."""

Interval = tuple[float, float]


def wilson(count: int, of: int) -> Interval:
    """Wilson's score interval of a proportion, at 95 %.

    Raises:
        ValueError: ``of`` is not positive.
    """
    if of <= 0:
        raise ValueError(f"expected a positive number of trials, got {of}")
    share, square = count / of, _Z**2
    centre = (share + square / (2 * of)) / (1 + square / of)
    half = _Z / (1 + square / of) * sqrt(share * (1 - share) / of + square / (4 * of**2))
    low = 0.0 if count == 0 else max(0.0, centre - half)
    high = 1.0 if count == of else min(1.0, centre + half)
    return low, high


def bootstrap_mean(values: Sequence[float]) -> Interval | None:
    """95 % percentile bootstrap interval of the mean; None: fewer than two values."""
    if len(values) < 2:
        return None
    sample = np.asarray(values, float)
    draws = np.random.default_rng(_SEED).integers(0, len(sample), (_RESAMPLES, len(sample)))
    tail = 50.0 * (1.0 - CONFIDENCE)
    low, high = np.percentile(sample[draws].mean(axis=1), [tail, 100.0 - tail])
    return float(low), float(high)


@dataclass(frozen=True)
class Paired:
    """Time of one condition minus that of another, over trials with the same start.

    A trial whose goal was not reached counts with the task's time limit.

    Attributes:
        pairs: how many.
        mean: of the differences [s].
        interval: of this mean, 95 % [s]; None: fewer than two pairs.
    """

    pairs: int
    mean: float
    interval: Interval | None


@dataclass(frozen=True)
class CellSummary:
    """One condition of one task, by one kind of operator.

    Attributes:
        operator: whose trials these are.
        task: its name.
        condition: its name.
        trials: how many.
        success: share.
        success_interval: of it, 95 %.
        partial: share of partial successes.
        failure: share of failures, errors of the simulation included.
        reached: trials that reached the goal; of these are the times.
        time_median, time_q1, time_q3, time_mean: completion times [s]; None: there are none.
        time_interval: of the mean, 95 % [s].
        charged_mean: mean time [s], those that did not reach the goal with the time limit.
        undesired: mean number of undesired contacts a trial.
        hand_path: mean length of the hands' ways [m].
        arm_acceleration: mean over trials [rad/s²].
        command, command_p99, feedback, feedback_p99: latency measured, mean over trials of the
            trial's mean, and the largest 99th percentile [s].
        command_asked, feedback_asked: mean asked for [s].
        difference: to the condition compared with; None: this is it, or there are no pairs.
    """

    operator: Operator
    task: str
    condition: str
    trials: int
    success: float
    success_interval: Interval
    partial: float
    failure: float
    reached: int
    time_median: float | None
    time_q1: float | None
    time_q3: float | None
    time_mean: float | None
    time_interval: Interval | None
    charged_mean: float
    undesired: float
    hand_path: float | None
    arm_acceleration: float | None
    command: float | None
    command_p99: float | None
    command_asked: float
    feedback: float | None
    feedback_p99: float | None
    feedback_asked: float
    difference: Paired | None = None

    def flat(self) -> dict[str, object]:
        """For a row of a table: intervals and differences as columns of their own."""
        row = asdict(self)
        for name in ("success_interval", "time_interval"):
            row[f"{name}_low"], row[f"{name}_high"] = row.pop(name) or (None, None)
        paired: dict[str, object] = row.pop("difference") or {}
        low, high = (self.difference and self.difference.interval) or (None, None)
        return row | {
            "difference_pairs": paired.get("pairs"),
            "difference_mean": paired.get("mean"),
            "difference_low": low,
            "difference_high": high,
        }


def paired(later: Iterable[TrialRow], earlier: Iterable[TrialRow]) -> Paired | None:
    """``later`` minus ``earlier``, by participant, task and seed; None: nothing in common.

    Trials in which the simulation itself failed are left out.
    """
    before = {_start(row): row.charged for row in earlier if row.verdict != "error"}
    values = [
        row.charged - before[_start(row)]
        for row in later
        if row.verdict != "error" and _start(row) in before
    ]
    if not values:
        return None
    return Paired(len(values), float(np.mean(values)), bootstrap_mean(values))


def summarise(
    rows: Sequence[TrialRow], conditions: Sequence[str], baseline: str
) -> list[CellSummary]:
    """Sum up every cell; operators are kept apart.

    Args:
        rows: trials in any order.
        conditions: names in the order in which they are to come.
        baseline: the condition the others are compared with.
    """
    cells: dict[tuple[Operator, str, str], list[TrialRow]] = {}
    for row in rows:
        cells.setdefault((row.operator, row.task, row.condition), []).append(row)
    tasks = list(dict.fromkeys(row.task for row in rows))
    operators: tuple[Operator, ...] = ("synthetic", "human")
    return [
        _cell(cells[at], None if name == baseline else cells.get((operator, task, baseline)))
        for operator in operators
        for task in tasks
        for name in conditions
        if (at := (operator, task, name)) in cells
    ]


def _start(row: TrialRow) -> tuple[str, str, str, int]:
    return row.operator, row.participant, row.task, row.seed


def _cell(rows: Sequence[TrialRow], baseline: Sequence[TrialRow] | None) -> CellSummary:
    times = sorted(row.time for row in rows if row.reached)
    quartiles = np.percentile(times, [25, 50, 75]).tolist() if times else [None] * 3
    count = {name: sum(row.verdict == name for row in rows) for name in ("success", "partial")}
    first, number = rows[0], len(rows)
    return CellSummary(
        operator=first.operator,
        task=first.task,
        condition=first.condition,
        trials=number,
        success=count["success"] / number,
        success_interval=wilson(count["success"], number),
        partial=count["partial"] / number,
        failure=1.0 - (count["success"] + count["partial"]) / number,
        reached=len(times),
        time_q1=quartiles[0],
        time_median=quartiles[1],
        time_q3=quartiles[2],
        time_mean=_mean(times),
        time_interval=bootstrap_mean(times),
        charged_mean=float(np.mean([row.charged for row in rows])),
        undesired=float(np.mean([len(row.undesired) for row in rows])),
        hand_path=_mean([row.hand_path for row in rows]),
        arm_acceleration=_mean([row.arm_acceleration for row in rows]),
        command=_mean([row.command.mean for row in rows]),
        command_p99=max(
            (row.command.p99 for row in rows if row.command.p99 is not None), default=None
        ),
        command_asked=float(np.mean([row.command.asked_mean for row in rows])),
        feedback=_mean([row.feedback.mean for row in rows]),
        feedback_p99=max(
            (row.feedback.p99 for row in rows if row.feedback.p99 is not None), default=None
        ),
        feedback_asked=float(np.mean([row.feedback.asked_mean for row in rows])),
        difference=None if baseline is None else paired(rows, baseline),
    )


def _mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
