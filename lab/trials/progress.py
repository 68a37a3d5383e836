"""Shows the progress of long work: a bar on a terminal, lines anywhere else."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import TracebackType
from typing import Self

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn


def duration(seconds: float) -> str:
    """Return a time as ``3:07`` or ``1:02:03``."""
    minutes, rest = divmod(round(seconds), 60)
    hours, minutes = divmod(minutes, 60)
    return f"{hours}:{minutes:02d}:{rest:02d}" if hours else f"{minutes}:{rest:02d}"


class Bar:
    """A bar with a text behind it; a context manager.

    Attributes:
        console: where it is shown.
    """

    def __init__(self, console: Console, name: str) -> None:
        self.console = console
        self._bar = Progress(
            TextColumn("{task.description}"),
            BarColumn(bar_width=20),
            MofNCompleteColumn(),
            TextColumn("{task.fields[text]}", markup=False),
            console=console,
            disable=not console.is_terminal,
        )
        self._row = self._bar.add_task(name, total=None, text="")

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

    def show(self, done: int, wanted: int, text: str) -> None:
        """Move it."""
        self._bar.update(self._row, completed=done, total=wanted, text=text)

    def say(self, text: str) -> None:
        """Print a line, above the bar if there is one."""
        self.console.print(text, markup=False, highlight=False, soft_wrap=True)


@contextmanager
def file_bar(console: Console, name: str, total: int) -> Iterator[Callable[[], None]]:
    """Show a bar, gone at the end, while files are read; yields what to call after each file."""
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        row = progress.add_task(name, total=total)
        yield lambda: progress.advance(row)
