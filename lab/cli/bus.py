"""Options of the subcommands that join the bus of a running system."""

import argparse
from pathlib import Path

from common.transport.config import BusConfig, bus_of, split_list


def add_config_option(parser: argparse._ActionsContainer) -> None:
    """Add the option that names the configuration file."""
    parser.add_argument("--config", type=Path, help="TOML file with the settings of all services")


def add_bus_options(parser: argparse._ActionsContainer, *, client: bool = True) -> None:
    """Add the options that identify a running system; without ``client`` no ``--connect``."""
    add_config_option(parser)
    parser.add_argument("--base-port", type=int, help="of the system (7448, or TRILL_BASE_PORT)")
    parser.add_argument("--robot", help="its name (draco3, or TRILL_ROBOT)")
    if client:
        add_connect_option(parser)


def add_connect_option(parser: argparse._ActionsContainer) -> None:
    """Add the option that joins the bus from another machine."""
    parser.add_argument(
        "--connect",
        type=split_list,
        metavar="ENDPOINT",
        help="join as a client of this router or service, e.g. tcp/robot:7447 (or TRILL_CONNECT)",
    )


def chosen_bus(arguments: argparse.Namespace) -> BusConfig:
    """Return the bus that the options name: as a client if ``--connect`` is given.

    Raises:
        ConfigError: the file, an option or an environment variable is wrong.
    """
    connect = getattr(arguments, "connect", None)
    return bus_of(
        arguments.config,
        base_port=arguments.base_port,
        robot=arguments.robot,
        connect=connect,
        mode="client" if connect else None,
    )
