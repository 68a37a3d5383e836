"""Runs the trials that a study lacks."""

from collections import defaultdict
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from statistics import fmean

from lab.studies.latency.plan import Plan, TrialKey
from lab.studies.latency.row import TrialRow
from lab.studies.latency.store import Store
from lab.studies.latency.trial import run_study_trial
from lab.trials.campaign import Executor, run_campaign


@dataclass
class StudyProgress:
    """Progress of the study.

    Attributes:
        wanted: number of trials in all.
        jobs: trials at a time.
        todo: trials that were missing at the start, in the order in which they are run.
        done: trials that have been run.
        resumed: number of trials that an earlier run had left.
    """

    wanted: int
    jobs: int
    todo: list[TrialKey]
    done: dict[TrialKey, TrialRow] = field(default_factory=dict)
    resumed: int = 0

    @property
    def left(self) -> float | None:
        """Estimated time left [s], from the trials so far; None: there is none yet."""
        walls: dict[tuple[str, str], list[float]] = defaultdict(list)
        for key, row in self.done.items():
            walls[key.task, key.condition].append(row.wall)
        if not walls:
            return None
        usual = fmean(row.wall for row in self.done.values())
        missing = [key for key in self.todo if key not in self.done]
        each = (fmean(walls.get((key.task, key.condition), [usual])) for key in missing)
        return sum(each) / min(self.jobs, max(1, len(missing)))


def run_study(
    plan: Plan,
    store: Store,
    open_executor: Callable[[], Executor],
    *,
    episodes: int,
    jobs: int,
    on_progress: Callable[[StudyProgress, TrialRow | None], None] = lambda _progress, _row: None,
    on_message: Callable[[str], None] = lambda _text: None,
) -> StudyProgress:
    """Run every trial that ``store`` lacks.

    Args:
        plan: the study's plan.
        store: keeps the trials.
        open_executor: makes the workers; called only if a trial is to be run.
        episodes: number of seeds in each condition of each task.
        jobs: trials at a time, to estimate the time left.
        on_progress: called with each new trial, and about twice a second without one.
        on_message: called with what the user should know of the workers.

    Raises:
        LabError: a trial has cost several workers, or the store cannot be used.
        ConfigError: the store was begun with other settings.
    """
    with store.writing(plan):
        trials = list(plan.trials(episodes))
        known = {TrialKey(row.seed, row.task, row.condition): row for row in store.rows()}
        done = {key: known[key] for key in trials if key in known}
        todo = [key for key in trials if key not in done]
        progress = StudyProgress(len(trials), jobs, todo, done, len(done))
        on_progress(progress, None)

        def keep(key: TrialKey, row: TrialRow) -> None:
            store.add(row)
            progress.done[key] = row
            on_progress(progress, row)

        if todo:
            run_campaign(
                todo,
                partial(run_study_trial, plan),
                open_executor(),
                on_result=keep,
                on_message=on_message,
                on_wait=lambda: on_progress(progress, None),
            )
    return progress
