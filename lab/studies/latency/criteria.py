"""Tests whether the trials show the shape of the paper's result, by stated criteria."""

from collections.abc import Iterator, Sequence
from itertools import groupby, pairwise, product
from statistics import fmean
from typing import Literal

from lab.studies.latency.conditions import Condition
from lab.studies.latency.plan import Plan
from lab.studies.latency.record import Record, StudyTrial
from lab.studies.latency.stats import paired_difference
from lab.trials.estimates import Estimate

Criterion = Literal["latency", "interpolation"]
FEWEST_PAIRS = 5
"""With fewer pairs of trials a comparison is left undecided."""
LITTLE = 0.10
"""Interpolation costs little if it adds less than this share of the time with raw input."""
CRITERIA = (
    "Criteria for every task, over trials with the same start; those that did not reach the goal "
    "count with the time limit. Intervals are 95 % bootstrap intervals of the mean paired "
    f"difference, from at least {FEWEST_PAIRS} pairs. latency: from each delay to the next longer "
    "one the interval is above 0. interpolation: against raw input the interval is below "
    f"{100 * LITTLE:.0f} % of the mean time with raw input."
)


class Comparison(Record):
    """Compares a condition with a reference condition in one task.

    Attributes:
        criterion: which criterion is applied.
        task: name of the task.
        condition: name of the condition.
        reference: name of the condition it is compared with.
        difference: time of the condition minus that of the reference, over pairs of trials [s].
        bound: what the interval must be above (latency) or below (interpolation) [s].
        met: whether the criterion is met; None: there are too few pairs.
    """

    criterion: Criterion
    task: str
    condition: str
    reference: str
    difference: Estimate
    bound: float
    met: bool | None


def compare(plan: Plan, trials: Sequence[StudyTrial]) -> list[Comparison]:
    """Apply the criteria to the trials of the synthetic operator."""
    cells: dict[tuple[str, str], list[StudyTrial]] = {}
    for trial in trials:
        if trial.operator == "synthetic" and trial.verdict != "error":
            cells.setdefault((trial.task, trial.condition), []).append(trial)
    return [
        _compare(
            criterion,
            task,
            (condition.name, cells.get((task, condition.name), [])),
            (reference.name, cells.get((task, reference.name), [])),
        )
        for criterion, condition, reference in _pairs(plan)
        for task in plan.tasks
    ]


def _pairs(plan: Plan) -> Iterator[tuple[Criterion, Condition, Condition]]:
    """Yield the conditions to be compared: criterion, condition, reference."""
    baseline = plan.baseline
    alike = [c for c in plan.conditions if c.raw_hands == baseline.raw_hands]
    by_delay = groupby(sorted(alike, key=lambda c: c.delay), key=lambda c: c.delay)
    # Several conditions may have the same delay.
    for shorter, longer in pairwise(list(group) for _, group in by_delay):
        yield from (("latency", *pair) for pair in product(longer, shorter))
    raw = next((c for c in plan.conditions if c.raw_hands and c.links == baseline.links), None)
    if raw is not None and not baseline.raw_hands:
        yield "interpolation", baseline, raw


def _compare(
    criterion: Criterion,
    task: str,
    condition: tuple[str, list[StudyTrial]],
    reference: tuple[str, list[StudyTrial]],
) -> Comparison:
    difference = paired_difference(condition[1], reference[1])
    bound, met = 0.0, None
    low, high = difference.low, difference.high
    if difference.count >= FEWEST_PAIRS and low is not None and high is not None:
        if criterion == "interpolation":
            seeds = {trial.seed for trial in condition[1]}
            bound = LITTLE * fmean(t.charged for t in reference[1] if t.seed in seeds)
        met = low > bound if criterion == "latency" else high < bound
    return Comparison(
        criterion=criterion,
        task=task,
        condition=condition[0],
        reference=reference[0],
        difference=difference,
        bound=bound,
        met=met,
    )


def reproduced(comparisons: Sequence[Comparison]) -> bool | None:
    """Whether both criteria are met in every task; None: there are too few trials to say so."""
    results = [comparison.met for comparison in comparisons]
    if False in results:
        return False
    criteria = {comparison.criterion for comparison in comparisons}
    return None if None in results or len(criteria) < 2 else True
