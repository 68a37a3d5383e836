"""Runs the trials that a study lacks, and shows the progress."""

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from statistics import fmean

from lab.progress import ProgressBar, format_duration
from lab.studies.latency.plan import Plan, TrialKey
from lab.studies.latency.record import StudyTrial
from lab.studies.latency.store import StudyStore
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
    done: dict[TrialKey, StudyTrial] = field(default_factory=dict)
    resumed: int = 0

    @property
    def left(self) -> float | None:
        """Estimated time left [s], from the trials so far; None: there is none yet."""
        if not self.done:
            return None
        missing = [key for key in self.todo if key not in self.done]
        walls = (self._usual_wall(key) for key in missing)
        return sum(walls) / min(self.jobs, max(1, len(missing)))

    def _usual_wall(self, key: TrialKey) -> float:
        """Return the mean time of trials like ``key``, or of all if there is none yet [s]."""
        kind = (key.task, key.condition)
        alike = [trial.wall for k, trial in self.done.items() if (k.task, k.condition) == kind]
        return fmean(alike or [trial.wall for trial in self.done.values()])


def run_study(
    plan: Plan,
    store: StudyStore,
    open_executor: Callable[[], Executor],
    *,
    episodes: int,
    jobs: int,
    on_progress: Callable[[StudyProgress, StudyTrial | None], None] = lambda _progress, _trial: (
        None
    ),
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
        keys = list(plan.keys(episodes))
        known = {
            TrialKey(trial.seed, trial.task, trial.condition): trial for trial in store.trials()
        }
        done = {key: known[key] for key in keys if key in known}
        todo = [key for key in keys if key not in done]
        progress = StudyProgress(len(keys), jobs, todo, done, len(done))
        on_progress(progress, None)

        def keep(key: TrialKey, trial: StudyTrial) -> None:
            store.add(trial)
            progress.done[key] = trial
            on_progress(progress, trial)

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


def show_progress(bar: ProgressBar, progress: StudyProgress, trial: StudyTrial | None) -> None:
    """Show a bar on a terminal, a line for each trial elsewhere; ``trial`` has just ended."""
    done, left = len(progress.done), progress.left
    eta = "" if left is None else f"ETA {format_duration(left)}"
    bar.show(done, progress.wanted, eta)
    if trial is None:
        return
    text = (
        f"{trial.task} {trial.condition} seed {trial.seed}: {trial.verdict} at {trial.time:.1f} s"
    )
    if trial.verdict != "success":
        text += f": {trial.reason}"
    if not bar.console.is_terminal:
        bar.say(f"[{done}/{progress.wanted}] {text}; {eta}")
    elif trial.verdict != "success":
        bar.say(text)
