"""Command-line options that say how a process reaches the bus."""

import argparse
from pathlib import Path

from common.ports import DEFAULT_BASE_PORT
from common.transport.config import split_list


def add_bus_options(group: argparse._ActionsContainer) -> None:
    """Add the options of services and router; None means that the option was not given."""
    group.add_argument(
        "--config", type=Path, help="TOML file with the settings of all services [TRILL_CONFIG]"
    )
    group.add_argument("--host", help="address of the port table (default: 127.0.0.1) [TRILL_HOST]")
    group.add_argument(
        "--base-port",
        type=int,
        help=f"first port of the table (default: {DEFAULT_BASE_PORT}) [TRILL_BASE_PORT]",
    )
    group.add_argument(
        "--connect",
        type=split_list,
        help="endpoints, by commas (default: those of the port table) [TRILL_CONNECT]",
    )
    group.add_argument(
        "--listen",
        type=split_list,
        help="endpoints, by commas (default: its own in the port table) [TRILL_LISTEN]",
    )
