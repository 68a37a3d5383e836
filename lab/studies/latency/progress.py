"""How far the study is: a bar on a terminal, a line a trial anywhere else."""

from rich.console import Console

from lab.progress import ProgressBar, format_duration
from lab.studies.latency.row import TrialRow
from lab.studies.latency.run import Standing


class Display(ProgressBar):
    """Shows the standing while it changes."""

    def __init__(self, console: Console) -> None:
        super().__init__("trials", console=console)

    def tell(self, standing: Standing, row: TrialRow | None) -> None:
        """Show how it stands; ``row`` is a trial that has just ended."""
        left = standing.left
        eta = "" if left is None else f"ETA {format_duration(left)}"
        done = len(standing.done)
        self.show(done, standing.wanted, eta)
        if row is None:
            return
        text = f"{row.task} {row.condition} seed {row.seed}: {row.verdict} at {row.time:.1f} s"
        if row.verdict != "success":
            text += f": {row.reason}"
        if not self.console.is_terminal:
            text = f"[{done}/{standing.wanted}] {text}; {eta}"
        elif row.verdict == "success":
            return
        self.say(text)
