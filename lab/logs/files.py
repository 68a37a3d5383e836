"""Finds a run's log, and shows how far reading it has got."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, Progress, TaskProgressColumn, TextColumn, TimeRemainingColumn

from deploy.system import LOG_FILE

ShowProgress = Callable[[float, float], None]
"""Shows how much is done, and of how much."""


def log_path(given: Path) -> Path:
    """Return the log file, given that or its run's directory."""
    return given / LOG_FILE if given.is_dir() else given


@contextmanager
def progress_bar(text: str) -> Iterator[ShowProgress]:
    """Show a bar on standard error until the block ends; nothing unless that is a terminal."""
    console = Console(stderr=True)
    columns = TextColumn("{task.description}"), BarColumn(), TaskProgressColumn()
    with Progress(
        *columns,
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task(text, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
