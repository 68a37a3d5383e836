"""Show the progress of long work: a bar on a terminal, one line per result elsewhere."""

from typing import Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

_LARGEST_COUNT = 9999
"""A larger total, for instance of bytes, is shown as a percentage."""


def format_duration(seconds: float) -> str:
    """Format a time span as ``3:07`` or ``1:02:03``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class ProgressBar:
    """A progress bar with a text behind it; a context manager.

    The bar is drawn on a terminal only and is gone when the context is left. Without a text it
    shows the estimated time left.

    Example::

        with ProgressBar("checking", total=len(files)) as bar:
            for file in files:
                bar.advance(f"{file}: {check(file)}")

    Attributes:
        console: standard error unless another one was given, so that a command's results on
            standard output stay clean.
    """

    def __init__(
        self, name: str, total: float | None = None, *, console: Console | None = None
    ) -> None:
        """Name the work; ``total`` is the number of its steps, None while it is unknown."""
        self.console = console or Console(stderr=True)
        self._progress = Progress(
            TextColumn("{task.description}", markup=False),
            BarColumn(bar_width=20),
            _CountColumn(),
            _TextColumn(),
            console=self.console,
            transient=True,
            disable=not self.console.is_terminal,
        )
        self._task = self._progress.add_task(name, total=total, text="")

    def __enter__(self) -> Self:
        """Draw the bar."""
        self._progress.start()
        return self

    def __exit__(self, *_error: object) -> None:
        """Remove the bar."""
        self._progress.stop()

    def advance(self, result: str = "") -> None:
        """Count one more step; off a terminal print its ``result``, if any, with the count."""
        self._progress.update(self._task, advance=1, text=result)
        if result and not self.console.is_terminal:
            self.say(f"[{_count(self._progress.tasks[0])}] {result}")

    def show(self, done: float, total: float | None = None, text: str = "") -> None:
        """Move the bar to ``done`` of ``total`` steps; None leaves the total as it is."""
        self._progress.update(self._task, completed=done, total=total, text=text)

    def say(self, text: str) -> None:
        """Print a line: above the bar on a terminal."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)


def _count(task: Task) -> str:
    """Format the progress as ``3/20`` or ``15 %``, or as ``3`` while the total is unknown."""
    if task.total is None:
        return f"{task.completed:.0f}"
    if task.total > _LARGEST_COUNT:
        return f"{task.percentage:.0f} %"
    return f"{task.completed:.0f}/{task.total:.0f}"


class _CountColumn(ProgressColumn):
    def render(self, task: Task) -> Text:
        return Text(_count(task))


class _TextColumn(TimeRemainingColumn):
    def render(self, task: Task) -> Text:
        text: str = task.fields["text"]
        return Text(text) if text else super().render(task)
