"""``trill top``: the live table of a running system."""

import argparse

from lab.cli.commands import Action
from lab.cli.system import bus_options

TEXT = """Show the live table of a running system, from any terminal and any number of times: the
controller's state and the plant's guard; which services run, and the timing of their loops;
injected delays, requested and achieved; services that are gone or whose clock differs; the rate,
age and losses of each topic; and the latency breakdown of each input (median/p99 of the last two
seconds in ms; `trill ledger --help` explains the stages). The table fits the terminal and publishes
nothing. Written to a pipe or a file it is one line every few seconds."""
EXAMPLES = """examples:
  trill top                           the system on the standard ports
  trill top --base-port 7464          the one that printed this base port when it started
  trill top --ledger                  the latency of every input, nothing else
  TRILL_CONNECT=tcp/robot:7447 TRILL_MODE=client trill top
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill top``."""
    bus_options(parser, "of the system to watch (7448, or TRILL_BASE_PORT)")
    parser.add_argument("--robot", help="its name (draco3, or TRILL_ROBOT)")
    part = parser.add_mutually_exclusive_group()
    part.add_argument("--topics", action="store_true", help="show nothing but all topics")
    part.add_argument(
        "--ledger", action="store_true", help="show nothing but the latency breakdown"
    )


def run(arguments: argparse.Namespace) -> int:
    """Show the table until Ctrl-C; returns 0."""
    from common.transport.config import bus_of
    from lab.monitor.monitor import watch
    from lab.monitor.table import Content

    bus = bus_of(arguments.base_port, arguments.config, arguments.robot)
    content = (
        Content.TOPICS if arguments.topics else Content.LEDGER if arguments.ledger else Content.ALL
    )
    watch(bus, f"trill top  {bus.robot}  base port {bus.base_port}", content)
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
