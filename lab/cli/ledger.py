"""``trill ledger``: the latency breakdown of every input of every service, from a log."""

import argparse
import sys
from math import inf
from pathlib import Path

from common.errors import ConfigError
from lab.cli.commands import Action
from lab.cli.log_argument import add_log_argument, chosen_log

TEXT = """Show the latency breakdown of every message that a service read, from a log: the exact
median and 99th percentile of each stage over all messages. Stages: capture (from capturing the
information to encoding it), encode, wire (transport, across hosts by their estimated clock offset),
injected (delay added by the link), queue (waiting for the consumer's next step), decode, use (from
the start of that step until its results were sent, decoding included), total.

For each link that injects delay the requested and the achieved delay and the number of lost
messages are shown; for each input how many messages were not used, and why."""
EXAMPLES = """examples:
  trill ledger runs/20260131-120000
  trill ledger log.mcap --from 20 --until 40        of this span only [s]
  trill ledger log.mcap --csv ledger.csv --plot ledger.png
  trill top --ledger                                live, over the last two seconds
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill ledger``."""
    add_log_argument(parser)
    parser.add_argument(
        "--from",
        dest="begin",
        type=float,
        default=0.0,
        metavar="S",
        help="start of the span [s] (0)",
    )
    parser.add_argument(
        "--until", dest="end", type=float, default=inf, metavar="S", help="end of the span [s]"
    )
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the table, in seconds")
    parser.add_argument("--plot", type=Path, metavar="FILE.png", help="plot the distributions")


def run(arguments: argparse.Namespace) -> int:
    """Show the latency breakdown of a log; exit code 0.

    Raises:
        ConfigError: the span is empty, or a file has a wrong name or place.
        LoggerError: the log cannot be read.
        LabError: it has no journals, or a file cannot be written.
    """
    from rich.console import Console

    from lab.logs.ledger_log import ledger_table, render, write_csv
    from services.logger.read.reader import LogReader

    begin, end = arguments.begin, arguments.end
    if not 0.0 <= begin < end:
        raise ConfigError(f"expected 0 <= --from < --until, got {begin:g} and {end:g}")
    _refuse_unwritable(arguments.csv, arguments.plot)
    path = chosen_log(arguments.log)
    with Console(stderr=True).status(f"reading {path}"):
        table = ledger_table(LogReader(path), begin, end)
    # A pipe has no width; cut nothing off there.
    console = Console(width=None if sys.stdout.isatty() else 140)
    console.print(render(table, f"latency breakdown of {arguments.log}"), soft_wrap=False)
    if arguments.csv is not None:
        write_csv(arguments.csv, table)
    if arguments.plot is not None:
        from lab.review.ledger_plot import write_plot

        write_plot(arguments.plot, table.inputs, f"{arguments.log}, {table.seconds:.1f} s")
    for written in (arguments.csv, arguments.plot):
        if written is not None:
            print(f"written: {written}")
    return 0


def _refuse_unwritable(table: Path | None, plot: Path | None) -> None:
    """Refuse before the long reading of the log what could not be written after it."""
    if plot is not None and plot.suffix.lower() != ".png":
        raise ConfigError(f"--plot: expected a name that ends in .png, got {plot}")
    for path in (table, plot):
        if path is not None and not path.absolute().parent.is_dir():
            raise ConfigError(f"cannot write {path}: there is no directory {path.parent}")


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
