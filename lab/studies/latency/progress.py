"""Shows the progress of the study: a bar on a terminal, a line for each trial elsewhere."""

from rich.console import Console

from lab.progress import ProgressBar, format_duration
from lab.studies.latency.row import TrialRow
from lab.studies.latency.run import StudyProgress


class Display(ProgressBar):
    """Shows the progress while it changes."""

    def __init__(self, console: Console) -> None:
        super().__init__("trials", console=console)

    def update(self, progress: StudyProgress, row: TrialRow | None) -> None:
        """Show the progress; ``row`` is a trial that has just ended."""
        left = progress.left
        eta = "" if left is None else f"ETA {format_duration(left)}"
        done = len(progress.done)
        self.show(done, progress.wanted, eta)
        if row is None:
            return
        text = f"{row.task} {row.condition} seed {row.seed}: {row.verdict} at {row.time:.1f} s"
        if row.verdict != "success":
            text += f": {row.reason}"
        if not self.console.is_terminal:
            text = f"[{done}/{progress.wanted}] {text}; {eta}"
        elif row.verdict == "success":
            return
        self.say(text)
