"""Whether the shape of the paper's result is there: decided by stated criteria, from the trials."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import groupby, pairwise, product
from statistics import fmean

from lab.studies.latency.conditions import Condition
from lab.studies.latency.plan import Plan
from lab.studies.latency.row import TrialRow
from lab.studies.latency.stats import Paired, paired

FEWEST_PAIRS = 5
"""With fewer no difference is called shown."""
LITTLE = 0.10
"""Interpolation costs little if it adds less than this share of the time with raw input."""
CRITERIA = (
    "Criteria, for each task, over trials with the same start, those that did not reach the goal "
    "counted with the time limit. Latency: from each delay to the next longer the mean time rises, "
    "the 95 % bootstrap interval of the paired difference above 0. Interpolation: the upper end of "
    f"that interval, against raw input, below {100 * LITTLE:.0f} % of raw input's mean time. At "
    f"least {FEWEST_PAIRS} pairs each."
)


@dataclass(frozen=True)
class Check:
    """One comparison.

    Attributes:
        task: in which.
        text: what was compared and what came out.
        held: whether the criterion is met; None: too few trials to tell.
        surprising: it is met, but otherwise than the paper tells.
    """

    task: str
    text: str
    held: bool | None
    surprising: bool = False


@dataclass(frozen=True)
class Finding:
    """What the trials of the synthetic operator say of the paper's result.

    Attributes:
        reproduced: None: too few trials, or nothing to compare.
        latency: whether time rises with latency, one check a step and task.
        interpolation: whether it costs little, one check a task.
        sentence: the conclusion.
    """

    reproduced: bool | None
    latency: tuple[Check, ...]
    interpolation: tuple[Check, ...]
    sentence: str


def find(plan: Plan, rows: Sequence[TrialRow]) -> Finding:
    """Compare the conditions of a study; only the synthetic operator's trials count."""
    cells: dict[tuple[str, str], list[TrialRow]] = {}
    for row in rows:
        if row.operator == "synthetic":
            cells.setdefault((row.task, row.condition), []).append(row)
    baseline = plan.baseline
    alike = [c for c in plan.conditions if c.raw_hands == baseline.raw_hands]
    raw = next((c for c in plan.conditions if c.raw_hands and c.links == baseline.links), None)
    latency, interpolation = [], []
    for task in plan.tasks:
        for shorter, longer in _steps(alike):
            pair = (cells.get((task, longer.name), []), cells.get((task, shorter.name), []))
            latency.append(_rises(task, longer, shorter, paired(*pair)))
        if raw is not None and not baseline.raw_hands:
            interpolation.append(
                _costs(task, cells.get((task, baseline.name), []), cells.get((task, raw.name), []))
            )
    return _conclude(tuple(latency), tuple(interpolation))


def _steps(conditions: Sequence[Condition]) -> Iterator[tuple[Condition, Condition]]:
    """Each condition with each of the next longer delay; several may have the same one."""
    by_delay = sorted(conditions, key=lambda c: c.delay)
    groups = [tuple(group) for _, group in groupby(by_delay, key=lambda c: c.delay)]
    for shorter, longer in pairwise(groups):
        yield from product(shorter, longer)


def _rises(task: str, longer: Condition, shorter: Condition, found: Paired | None) -> Check:
    head = f"{longer.title} against {shorter.title}: "
    if found is None or found.interval is None or found.pairs < FEWEST_PAIRS:
        return Check(task, head + _few(found), None)
    low, high = found.interval
    text = f"{found.mean:+.2f} s [{low:+.2f}, {high:+.2f}]"
    return Check(task, head + text, low > 0.0)


def _costs(task: str, with_it: list[TrialRow], raw: list[TrialRow]) -> Check:
    found = paired(with_it, raw)
    head = "interpolation against raw input: "
    if found is None or found.interval is None or found.pairs < FEWEST_PAIRS:
        return Check(task, head + _few(found), None)
    low, high = found.interval
    seeds = {row.seed for row in with_it if row.verdict != "error"}
    usual = fmean(r.charged for r in raw if r.seed in seeds and r.verdict != "error")
    text = (
        f"{found.mean:+.2f} s [{low:+.2f}, {high:+.2f}], "
        f"{100 * found.mean / usual:+.1f} % of {usual:.1f} s"
    )
    if high < 0.0:
        text += "; raw input was the slower one"
    return Check(task, head + text, high < LITTLE * usual, surprising=high < 0.0)


def _few(found: Paired | None) -> str:
    pairs = 0 if found is None else found.pairs
    return f"{pairs} pairs, at least {FEWEST_PAIRS} needed"


def _conclude(latency: tuple[Check, ...], interpolation: tuple[Check, ...]) -> Finding:
    parts = {"time rises with latency": latency, "interpolation costs little": interpolation}
    held = {name: _all(checks) for name, checks in parts.items()}
    missing = [name for name, so in held.items() if so is None]
    wrong = [
        f"{check.task}, {check.text}"
        for checks in parts.values()
        for check in checks
        if check.held is False
    ]
    refuted = [name for name, so in held.items() if so is False]
    if refuted:
        text = (
            f"The shape of the paper's result is NOT reproduced: it does not hold in every task "
            f"that {' and that '.join(refuted)} ({'; '.join(wrong)})."
        )
        return Finding(False, latency, interpolation, text)
    if missing:
        text = (
            "Whether the shape of the paper's result is reproduced cannot be told: too few trials, "
            f"or no conditions, to say whether {' and whether '.join(missing)}."
        )
        return Finding(None, latency, interpolation, text)
    text = (
        "The shape of the paper's result is reproduced with the synthetic operator: in every task "
        "time rises with latency and interpolation costs little."
    )
    odd = [check.task for check in interpolation if check.surprising]
    if odd:
        text += (
            f" Unlike in the paper, raw input was not the quickest: in {' and '.join(odd)} the "
            "operator took longer with it than with interpolation."
        )
    return Finding(True, latency, interpolation, text)


def _all(checks: tuple[Check, ...]) -> bool | None:
    """False as soon as one is; None if any, or all, cannot be told."""
    if any(check.held is False for check in checks):
        return False
    return None if not checks or any(check.held is None for check in checks) else True
