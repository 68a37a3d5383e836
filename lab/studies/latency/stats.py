"""Statistics of the study; imported only for a report, because scipy.stats is slow to import."""

from collections.abc import Iterable, Sequence

import numpy as np

from lab.studies.latency.record import LinkLatency, Operator, Record, StudyTrial
from lab.trials.estimates import Estimate, Proportion, mean_estimate, proportion


def paired_difference(trials: Iterable[StudyTrial], reference: Iterable[StudyTrial]) -> Estimate:
    """Estimate by how much ``trials`` take longer than ``reference`` [s].

    Trials are paired by operator, participant, task and seed. A trial that did not reach the goal
    counts with the task's time limit; trials whose simulation failed are left out.
    """
    before = {_start(trial): trial.charged for trial in reference if trial.verdict != "error"}
    return mean_estimate(
        [
            trial.charged - before[_start(trial)]
            for trial in trials
            if trial.verdict != "error" and _start(trial) in before
        ]
    )


def _start(trial: StudyTrial) -> tuple[str, str, str, int]:
    return trial.operator, trial.participant, trial.task, trial.seed


class CellSummary(Record):
    """The trials of one condition of one task by one kind of operator.

    Attributes:
        operator: who did the trials.
        task: name of the task.
        condition: name of the condition.
        trials: number of trials.
        success: share of successes.
        partial: share of partial successes.
        failure: share of failures, failed simulations included.
        time: mean completion time of the trials that reached the goal [s].
        time_median: median of these times [s]; None: there are none.
        time_q1: first quartile of these times [s].
        time_q3: third quartile of these times [s].
        charged_mean: mean time of all trials [s]; one that missed the goal counts with the limit.
        undesired: mean number of undesired contacts in a trial.
        hand_path: mean length of the hands' path [m]; None: not measured.
        arm_acceleration: mean of the trials' arm acceleration [rad/s²]; None: not measured.
        command: latency from operator to robot: mean over trials, and largest percentiles.
        feedback: latency from robot to operator, likewise.
        difference: by how much trials take longer than under the baseline [s].
    """

    operator: Operator
    task: str
    condition: str
    trials: int
    success: Proportion
    partial: float
    failure: float
    time: Estimate
    time_median: float | None
    time_q1: float | None
    time_q3: float | None
    charged_mean: float
    undesired: float
    hand_path: float | None
    arm_acceleration: float | None
    command: LinkLatency
    feedback: LinkLatency
    difference: Estimate


def summarise(
    trials: Sequence[StudyTrial], conditions: Sequence[str], baseline: str
) -> list[CellSummary]:
    """Summarise every condition of every task; the kinds of operator are kept apart.

    Args:
        trials: trials in any order.
        conditions: names of the conditions in the order of the result.
        baseline: name of the condition that the others are compared with.
    """
    cells: dict[tuple[Operator, str, str], list[StudyTrial]] = {}
    for trial in trials:
        cells.setdefault((trial.operator, trial.task, trial.condition), []).append(trial)
    tasks = list(dict.fromkeys(trial.task for trial in trials))
    operators: tuple[Operator, ...] = ("synthetic", "human")
    return [
        _cell(cells[at], [] if name == baseline else cells.get((operator, task, baseline), []))
        for operator in operators
        for task in tasks
        for name in conditions
        if (at := (operator, task, name)) in cells
    ]


def _cell(trials: Sequence[StudyTrial], baseline: Sequence[StudyTrial]) -> CellSummary:
    number, first = len(trials), trials[0]
    successes = sum(trial.verdict == "success" for trial in trials)
    partial = sum(trial.verdict == "partial" for trial in trials)
    times = sorted(trial.time for trial in trials if trial.reached)
    q1, median, q3 = np.percentile(times, [25, 50, 75]).tolist() if times else [None] * 3
    return CellSummary(
        operator=first.operator,
        task=first.task,
        condition=first.condition,
        trials=number,
        success=proportion(successes, number),
        partial=partial / number,
        failure=(number - successes - partial) / number,
        time=mean_estimate(times),
        time_median=median,
        time_q1=q1,
        time_q3=q3,
        charged_mean=float(np.mean([trial.charged for trial in trials])),
        undesired=float(np.mean([len(trial.undesired) for trial in trials])),
        hand_path=_known_mean(trial.hand_path for trial in trials),
        arm_acceleration=_known_mean(trial.arm_acceleration for trial in trials),
        command=_link([trial.command for trial in trials]),
        feedback=_link([trial.feedback for trial in trials]),
        difference=paired_difference(trials, baseline),
    )


def _link(links: Sequence[LinkLatency]) -> LinkLatency:
    return LinkLatency(
        asked_mean=float(np.mean([link.asked_mean for link in links])),
        asked_p99=max(link.asked_p99 for link in links),
        mean=_known_mean(link.mean for link in links),
        p99=max((link.p99 for link in links if link.p99 is not None), default=None),
        used=sum(link.used for link in links),
        lost=sum(link.lost for link in links),
    )


def _known_mean(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known else None
