"""``trill top``: the live table of a running system."""

import argparse

from lab.cli.bus import add_bus_options, chosen_bus
from lab.cli.commands import Action

TEXT = """Show the live table of a running system, from any terminal and any number of times: the
controller's state, the plant's guard, who has the robot and who has stopped it; which services run,
and the timing of their loops; injected delays, requested and achieved; services that are gone or
whose clock differs; the rate, age and losses of each topic; and the latency breakdown of each input
(median/p99 of the last two seconds in ms; `trill ledger --help` explains the stages). The table
fits the terminal and publishes nothing. Written to a pipe or a file it is one line every few
seconds."""
EXAMPLES = """examples:
  trill top                           the system on the standard ports
  trill top --base-port 7464          the one that printed this base port when it started
  trill top --ledger                  the latency of every input, nothing else
  TRILL_CONNECT=tcp/robot:7447 TRILL_MODE=client trill top
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill top``."""
    add_bus_options(parser, client=False)
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--topics", action="store_true", help="show nothing but all topics")
    part.add_argument(
        "--ledger", action="store_true", help="show nothing but the latency breakdown"
    )


def run(arguments: argparse.Namespace) -> int:
    """Show the table until Ctrl-C; returns 0."""
    from lab.monitor.monitor import watch
    from lab.monitor.table import Content

    bus = chosen_bus(arguments)
    content = (
        Content.TOPICS if arguments.topics else Content.LEDGER if arguments.ledger else Content.ALL
    )
    watch(bus, f"trill top  {bus.robot}  base port {bus.base_port}", content)
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
