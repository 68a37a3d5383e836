"""Summarises trials as the rows of a table: one for each operator, task and link."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from statistics import fmean
from typing import NamedTuple

from lab.trials.estimates import Estimate, Proportion, mean_estimate, proportion
from lab.trials.links import links_text
from lab.trials.operators.specs import PolicySpec
from lab.trials.spec import TrialResult, TrialSpec

Trial = tuple[TrialSpec, TrialResult]
Start = tuple[str, int, str]
"""What two trials share that can be compared: task, seed, link."""


class Row(NamedTuple):
    """The trials of one operator in one task under one link.

    Attributes:
        label: name of the operator.
        task: name of the task.
        link: injected delays in words.
        episodes: demonstrations that the policy learned from; None: it is none.
        checkpoints: how many policies of this name are pooled, for instance of several trainings.
        results: the trials, by seed.
        success: share of successes.
        partial: share of trials that reached the goal at least in part, successes included, as
            the paper counts.
        still: mean time that a trial stood still [s]; None: not measured.
        falls: number of falls.
        difference: by how much it takes longer than the operator from the same start, of seeds in
            which both succeed [s].
    """

    label: str
    task: str
    link: str
    episodes: int | None
    checkpoints: int
    results: tuple[TrialResult, ...]
    success: Proportion
    partial: Proportion
    still: float | None
    falls: int
    difference: Estimate

    @property
    def times(self) -> list[float]:
        """Completion times of the successes [s]."""
        return [result.time for result in self.results if result.verdict == "success"]


def label_of(spec: TrialSpec) -> str:
    """Return the name of the row that a trial belongs to."""
    operator = spec.operator
    return operator.label if isinstance(operator, PolicySpec) else f"operator ({operator})"


def start_of(spec: TrialSpec, result: TrialResult) -> Start:
    """Return what a trial shares with another one that it can be compared with."""
    return spec.task, spec.seed, links_text(result.links)


def success_times(trials: Iterable[Trial]) -> dict[Start, float]:
    """Return the completion times of the successes [s]."""
    return {start_of(s, r): r.time for s, r in trials if r.verdict == "success"}


def summarise(trials: Iterable[Trial], operator: Mapping[Start, float]) -> list[Row]:
    """Return the rows, in the order in which their first trials come.

    Args:
        trials: the trials.
        operator: completion times to compare with.
    """
    cells: dict[tuple[str, str, str, int | None], list[Trial]] = {}
    for spec, result in trials:
        at = (label_of(spec), spec.task, links_text(result.links), _episodes(spec))
        cells.setdefault(at, []).append((spec, result))
    return [_row(*at, cell, operator) for at, cell in cells.items()]


def _episodes(spec: TrialSpec) -> int | None:
    if not isinstance(spec.operator, PolicySpec):
        return None
    return int(spec.operator.about.get("origin", {}).get("episodes", 0))


def _row(
    label: str,
    task: str,
    link: str,
    episodes: int | None,
    trials: Sequence[Trial],
    operator: Mapping[Start, float],
) -> Row:
    results = tuple(sorted((result for _, result in trials), key=lambda result: result.seed))

    def share(counts: Callable[[TrialResult], bool]) -> Proportion:
        return proportion(sum(map(counts, results)), len(results))

    mine = success_times(trials)
    still = [result.still for result in results if result.still is not None]
    return Row(
        label,
        task,
        link,
        episodes,
        len({s.operator.digest for s, _ in trials if isinstance(s.operator, PolicySpec)}),
        results,
        success=share(lambda result: result.verdict == "success"),
        partial=share(lambda result: result.verdict in {"success", "partial"}),
        still=fmean(still) if still else None,
        falls=sum(result.fell for result in results),
        difference=mean_estimate([mine[at] - operator[at] for at in mine if at in operator]),
    )
