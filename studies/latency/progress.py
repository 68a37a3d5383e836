"""How far the study is: a bar on a terminal, a line a trial anywhere else."""

from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn

from studies.latency.row import TrialRow
from studies.latency.run import Standing


class Display:
    """Shows the standing while it changes; a context manager."""

    def __init__(self, console: Console) -> None:
        self._console = console
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
            disable=not console.is_terminal,
        )
        self._row = self._bar.add_task("trials", total=None, left="")

    def __enter__(self) -> Self:
        self._bar.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._bar.stop()

    def tell(self, standing: Standing, row: TrialRow | None) -> None:
        """Show how it stands; ``row`` is a trial that has just ended."""
        left = standing.left
        eta = "" if left is None else f"ETA {_duration(left)}"
        done = len(standing.done)
        self._bar.update(self._row, completed=done, total=standing.wanted, left=eta)
        if row is None:
            return
        text = f"{row.task} {row.condition} seed {row.seed}: {row.verdict} at {row.time:.1f} s"
        if row.verdict != "success":
            text += f": {row.reason}"
        if not self._console.is_terminal:
            text = f"[{done}/{standing.wanted}] {text}; {eta}"
        elif row.verdict == "success":
            return
        self.say(text)

    def say(self, text: str) -> None:
        """Print a line above the bar."""
        self._console.print(text, markup=False, highlight=False, soft_wrap=True)


def _duration(seconds: float) -> str:
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"
