"""Runs the trials that a study lacks, and shows the progress."""

from collections import Counter
from collections.abc import Callable, Iterable
from functools import partial

from lab.progress import ProgressBar, format_duration
from lab.studies.latency.plan import Plan, TrialKey
from lab.studies.latency.record import StudyTrial
from lab.studies.latency.store import StudyStore
from lab.trials.campaign import Executor, run_campaign


class StudyProgress:
    """Progress of the study; a trial is counted in the same time however many there are.

    Attributes:
        wanted: number of trials in all.
        done: number of trials that have been run.
        resumed: number of trials that an earlier run had left.
    """

    def __init__(self, jobs: int, todo: Iterable[TrialKey], there: Iterable[StudyTrial]) -> None:
        """Begin.

        Args:
            jobs: trials at a time.
            todo: trials that are missing.
            there: trials that an earlier run had left.
        """
        self._jobs = jobs
        self._missing = Counter((key.task, key.condition) for key in todo)
        self._walls: dict[tuple[str, str], tuple[int, float]] = {}
        self.done = 0
        for trial in there:
            self._count(trial)
        self.resumed = self.done
        self.wanted = self.done + self._missing.total()

    def add(self, trial: StudyTrial) -> None:
        """Count a trial that was missing."""
        self._missing[trial.task, trial.condition] -= 1
        self._count(trial)

    def _count(self, trial: StudyTrial) -> None:
        kind = (trial.task, trial.condition)
        number, wall = self._walls.get(kind, (0, 0.0))
        self._walls[kind] = (number + 1, wall + trial.wall)
        self.done += 1

    @property
    def left(self) -> float | None:
        """Estimated time left [s], from the trials so far; None: there is none yet.

        A trial takes the mean time of those with its task and condition, or of all if there is
        none yet.
        """
        if not self.done:
            return None
        usual = (self.done, sum(wall for _, wall in self._walls.values()))
        total = 0.0
        for kind, missing in self._missing.items():
            number, wall = self._walls.get(kind, usual)
            total += missing * wall / number
        return total / min(self._jobs, max(1, self._missing.total()))


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
        todo = [key for key in keys if key not in known]
        progress = StudyProgress(jobs, todo, [known[key] for key in keys if key in known])
        on_progress(progress, None)

        def keep(_key: TrialKey, trial: StudyTrial) -> None:
            store.add(trial)
            progress.add(trial)
            on_progress(progress, trial)

        if todo:
            run_campaign(
                todo,
                partial(_run_trial, plan),
                open_executor(),
                on_result=keep,
                on_message=on_message,
                on_wait=lambda: on_progress(progress, None),
            )
    return progress


def _run_trial(plan: Plan, key: TrialKey) -> StudyTrial:
    """Run a trial in a worker."""
    # Robot, controller and operator take long to import, and the workers alone need them.
    from lab.studies.latency.trial import run_study_trial

    return run_study_trial(plan, key)


def show_progress(bar: ProgressBar, progress: StudyProgress, trial: StudyTrial | None) -> None:
    """Show a bar on a terminal, a line for each trial elsewhere; ``trial`` has just ended."""
    done, left = progress.done, progress.left
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
