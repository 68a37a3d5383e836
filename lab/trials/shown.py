"""Runs trials with a progress bar, and keeps their results in a file."""

from collections.abc import Callable, Sequence
from pathlib import Path

from common.errors import ConfigError
from lab.errors import LabError
from lab.progress import ProgressBar
from lab.trials.executors import open_executor
from lab.trials.results import TrialFile, run_trials
from lab.trials.spec import TrialResult, TrialSpec


def run_shown(
    trials: Sequence[TrialSpec],
    out: Path | None,
    jobs: int | None,
    ray: str | None,
    line: Callable[[TrialSpec, TrialResult], str],
) -> list[TrialResult]:
    """Run the trials that ``out`` lacks; return all results in the order of ``trials``.

    Args:
        trials: the trials.
        out: keeps their results; None: nothing does.
        jobs: as for :func:`~lab.trials.executors.open_executor`.
        ray: address as for :func:`~lab.trials.executors.open_executor`.
        line: formats one trial for the progress.

    Raises:
        ConfigError: ``out`` cannot be used.
        TrillError: a trial could not be begun, or cost several workers.
    """
    try:
        file = TrialFile(out)
    except LabError as error:
        raise ConfigError(f"--out: {error}") from error
    count = sum(file.result(trial) is not None for trial in trials)
    with ProgressBar("trials", len(trials)) as bar:
        if count:
            bar.say(f"{count} of {len(trials)} trials are in {file.path} already")
        if file.other_code:
            bar.say(f"{file.other_code} trials in {file.path} were run by other code: not used")
        bar.show(count)

        def on_result(trial: TrialSpec, result: TrialResult) -> None:
            nonlocal count
            count += 1
            bar.advance()
            bar.say(f"[{count}/{len(trials)}] {line(trial, result)}")

        return run_trials(
            trials,
            file,
            lambda: open_executor(jobs, ray),
            on_result=on_result,
            on_message=bar.say,
        )
