"""``trill ledger``: where the time of every message went, from a log."""

import argparse
import io
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from math import inf
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import ConfigError
from deploy.system import LOG_FILE
from lab.cli.commands import Action

if TYPE_CHECKING:
    from services.logger.read.reader import LogReader

TEXT = """Where the time went of every message a service took in, from a log: median and 99th
percentile, exact and over all messages, of each stage of its way. capture: from taking in the
information to encoding it; encode; wire: transport, across hosts by their estimated clock offset;
injected: held by the link on purpose; queue: waiting for the consumer's next step; decode; use:
from the start of that step until its results were sent, decoding included; total: all of it.

For each link that injects delay also what was asked for, what was done and how many messages it
lost; and of each input how many messages were not used, and why."""
EXAMPLES = """examples:
  trill ledger runs/20260131-120000
  trill ledger log.mcap --from 20 --until 40        of this span only [s]
  trill ledger log.mcap --csv ledger.csv --plot ledger.png
  trill top --ledger                                the same live, over the last two seconds
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill ledger``."""
    parser.add_argument("log", type=Path, help="log.mcap, or the directory of its run")
    parser.add_argument(
        "--from", dest="begin", type=float, default=0.0, metavar="S", help="begin here [s] (0)"
    )
    parser.add_argument(
        "--until", dest="end", type=float, default=inf, metavar="S", help="end here [s]"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the figures, in seconds")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="draw the distributions")


def run(arguments: argparse.Namespace) -> int:
    """Show the ledger of a log; exit code 0.

    Raises:
        ConfigError: the span is none, or a file cannot be what it is called.
        LoggerError: the log cannot be read.
        LabError: it has no ledger, or a file cannot be written.
    """
    from rich.console import Console

    from lab.logs.ledger_log import ledger_table, render, write_csv
    from services.logger.read.reader import LogReader

    begin, end = arguments.begin, arguments.end
    if not 0.0 <= begin < end:
        raise ConfigError(f"expected 0 <= --from < --until, got {begin:g} and {end:g}")
    _refuse_unwritable(arguments.csv, arguments.plot)
    path: Path = arguments.log / LOG_FILE if arguments.log.is_dir() else arguments.log
    with _progress(path) as progress:
        table = ledger_table(LogReader(path), begin, end, progress)
    # A pipe has no width of its own; nothing should be cut off there.
    console = Console(width=None if sys.stdout.isatty() else 140)
    console.print(render(table, f"ledger of {arguments.log}"), soft_wrap=False)
    if arguments.csv is not None:
        write_csv(arguments.csv, table)
    if arguments.plot is not None:
        from lab.review.ledger_plot import write_plot

        write_plot(arguments.plot, table.inputs, f"{arguments.log}, {table.seconds:.1f} s")
    for written in (arguments.csv, arguments.plot):
        if written is not None:
            print(f"written: {written}")
    return 0


def as_text(log: "LogReader") -> str:
    """The ledger of a log as plain text.

    Raises:
        LoggerError: the log cannot be read.
        LabError: it has no ledger.
    """
    from rich.console import Console

    from lab.logs.ledger_log import ledger_table, render

    out = io.StringIO()
    Console(file=out, width=140).print(render(ledger_table(log), f"ledger of {log.path}"))
    return out.getvalue()


def _refuse_unwritable(table: Path | None, plot: Path | None) -> None:
    """Say before the log is read, which may take a while, what could not be written afterwards."""
    if plot is not None and plot.suffix.lower() != ".png":
        raise ConfigError(f"--plot: expected a name that ends in .png, got {plot}")
    for path in (table, plot):
        if path is not None and not path.absolute().parent.is_dir():
            raise ConfigError(f"cannot write {path}: there is no directory {path.parent}")


@contextmanager
def _progress(path: Path) -> Iterator[Callable[[int], None]]:
    """Say on a terminal how much of the log was read."""
    from rich.console import Console
    from rich.progress import Progress, SpinnerColumn, TextColumn

    console = Console(stderr=True)
    columns = (SpinnerColumn(), TextColumn("{task.description}"))
    quiet = not console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=quiet) as bar:
        task = bar.add_task(f"reading {path}", total=None)
        yield lambda ns: bar.update(task, description=f"reading {path}: {1e-9 * ns:.0f} s")


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
