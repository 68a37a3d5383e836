"""Run a service from the command line: arguments, configuration file, runner.

A service's ``__main__`` hands :func:`run_live` a function that builds the service from its parsed
arguments::

    def build(arguments: Namespace) -> Service:
        return WbcService(WbcConfig.model_validate(arguments.settings))

    raise SystemExit(run_live(build, "wbc"))

The configuration file is TOML and may serve the whole stack: ``[bus]`` (see
:class:`common.transport.config.BusConfig`), ``[links]`` (see :mod:`common.links.config`),
``[runtime]`` (see :class:`RuntimeConfig`) and one table per service, which is handed to the
service's factory as ``arguments.settings``.
"""

import argparse
import logging
import os
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from common.errors import TrillError, report
from common.links.config import Links, parse_link_options
from common.runtime.live.components import Component
from common.runtime.live.config import RuntimeConfig
from common.runtime.live.realtime import DEFAULT_PRIORITY, enter_realtime
from common.runtime.live.runner import LiveRunner
from common.runtime.service import Service
from common.tables import validated
from common.transport.config import BusConfig, bus_config, read_config_file
from common.transport.options import add_bus_options

ServiceFactory = Callable[[argparse.Namespace], Service]
"""Builds a service from its parsed arguments: its options, ``settings`` (its table in the file) and
``max_age`` (by topic, the largest ages [s] that rule instead of the table's)."""


class OptionFormatter(argparse.ArgumentDefaultsHelpFormatter):
    """Shows defaults in help texts, except None, empty ones and False."""

    def _get_help_string(self, action: argparse.Action) -> str | None:
        default = action.default
        if default is None or default is False or default in ("", []):
            return action.help
        return super()._get_help_string(action)


def argument_parser(
    name: str,
    description: str | None = None,
    *,
    background: bool = False,
    delayable: bool = True,
) -> argparse.ArgumentParser:
    """Return a parser with the options that every service has.

    Args:
        name: the service's name.
        description: one line for ``--help``.
        background: the service may be late, so it uses real-time scheduling only if the option
            asks for it, whatever file and environment contain.
        delayable: whether its inputs can be delayed.
    """
    parser = argparse.ArgumentParser(
        prog=f"python -m services.{name}",
        description=description,
        formatter_class=OptionFormatter,
    )
    group = parser.add_argument_group("bus and runtime")
    add_bus_options(group)
    group.add_argument("--robot", help="first part of every key (default: draco3) [TRILL_ROBOT]")
    group.add_argument(
        "--mode",
        choices=["peer", "client", "router"],
        help="peer (default): connects to the other services directly; client: reaches them "
        "through a router, for instance across a firewall; router: passes on for clients "
        "[TRILL_MODE]",
    )
    if delayable:
        group.add_argument(
            "--link",
            action="append",
            metavar="NAME=SPEC",
            help="delay inputs: command, camera, feedback, both or a topic, e.g. "
            "'camera=normal(122ms, 190ms) loss=1%%'; see trill latency --help [TRILL_LINKS]",
        )
    parser.set_defaults(link=[])
    if background:
        priority = "SCHED_FIFO priority, 0 for none; only this option counts"
    else:
        priority = f"SCHED_FIFO priority, 0: none (default: {DEFAULT_PRIORITY}) [TRILL_RT_PRIORITY]"
    group.add_argument("--rt-priority", type=int, help=priority)
    parser.set_defaults(rt_priority=0 if background else None)
    return parser


def load_settings(
    arguments: argparse.Namespace, name: str, environment: Mapping[str, str] | None = None
) -> tuple[BusConfig, Links, RuntimeConfig, dict[str, Any]]:
    """Combine file, environment and arguments (later ones win) for service ``name``.

    Returns:
        bus configuration, links (all consumers), runtime configuration, the service's own table.

    Raises:
        ConfigError: a file, variable or option is wrong.
    """
    environment = os.environ if environment is None else environment
    path = arguments.config or environment.get("TRILL_CONFIG")
    tables = read_config_file(Path(path), also=[name]) if path else {}
    bus = bus_config(
        tables.get("bus"),
        {
            key: getattr(arguments, key)
            for key in ("robot", "mode", "host", "base_port", "connect", "listen")
        },
        environment,
    )
    links = (
        Links.from_table(tables.get("links", {}), also=[name])
        .under(Links.from_variable(environment.get("TRILL_LINKS", ""), also=[name]))
        .under(Links.from_table(parse_link_options(arguments.link), also=[name]))
    )
    runtime_values = dict(tables.get("runtime", {}))
    priority = environment.get("TRILL_RT_PRIORITY") or None
    if arguments.rt_priority is not None:
        priority = arguments.rt_priority
    if priority is not None:
        runtime_values["rt_priority"] = priority
    runtime = validated(RuntimeConfig, runtime_values, what="the runtime configuration")
    return bus, links, runtime, tables.get(name, {})


def run_live(
    service_factory: ServiceFactory,
    name: str,
    argv: Sequence[str] | None = None,
    *,
    add_arguments: Callable[[argparse.ArgumentParser], None] | None = None,
    description: str | None = None,
    background: bool = False,
    components: Callable[[Service], Sequence[Component]] = lambda _service: (),
) -> int:
    """Parse the arguments, build the service and run it live until a signal or an error.

    Args:
        service_factory: called once with the parsed arguments, after real-time scheduling was
            taken and before the bus is opened.
        name: the service's name in the port table and the configuration file.
        argv: arguments without the program's name; None takes the process's own.
        add_arguments: adds the service's own options to the parser.
        description: one line for ``--help``.
        background: see :func:`argument_parser`.
        components: returns parts of the service that need its session.

    Returns:
        exit code: 0 after a signal, 1 after an error, 2 for a wrong configuration.
    """
    logging.basicConfig(level=logging.INFO, format="%(levelname)s %(name)s: %(message)s")
    parser = argument_parser(name, description, background=background)
    if add_arguments is not None:
        add_arguments(parser)
    arguments = parser.parse_args(argv)
    try:
        bus, links, runtime, arguments.settings = load_settings(arguments, name)
        arguments.max_age = runtime.max_age
        # Before anything starts threads, so that the transport's threads inherit it.
        realtime = enter_realtime(runtime.rt_priority)
        service = service_factory(arguments)
    except TrillError as error:
        return report(name, error)
    return LiveRunner(
        service,
        bus,
        links=links,
        runtime=runtime,
        realtime=realtime,
        components=components(service),
    ).run()
