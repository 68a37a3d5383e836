"""Shows the progress of the study: a bar on a terminal, a line for each trial elsewhere."""

from lab.progress import ProgressBar, format_duration
from lab.studies.latency.record import StudyTrial
from lab.studies.latency.run import StudyProgress


def show_progress(bar: ProgressBar, progress: StudyProgress, trial: StudyTrial | None) -> None:
    """Show the progress; ``trial`` has just ended."""
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
