"""``python -m services.logger``: record everything on the bus."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pydantic import ValidationError

from common.errors import ConfigError, TrillError, explain
from common.runtime.live.main import argument_parser, load_settings
from common.runtime.live.realtime import enter_realtime
from common.runtime.live.stopping import StopSignals
from common.transport.config import split_list
from services.logger.errors import LoggerError
from services.logger.read.delivery import format_report
from services.logger.record.config import LoggerConfig
from services.logger.record.service import LoggerService, Order, record
from services.logger.record.units import parse_duration, parse_size

FILE_NAME = "log.mcap"
PRIORITY = 1
"""The lowest of SCHED_FIFO."""


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = argument_parser(
        LoggerService.name,
        "Record every message on the robot's bus to an MCAP file, as the very bytes that were "
        "sent, until Ctrl-C. Prints how many messages of each topic were sent, recorded, lost on "
        "the way and dropped. A killed logger loses less than a second; the file stays readable, "
        "and `trill repair` makes it whole.",
        # Whatever file and environment say of the control loop is not meant for the recorder, and
        # it records every message when it arrives.
        background=True,
        delayable=False,
    )
    # Below every service of the robot, so that it never takes the processor from the control
    # loop; above all else, since what waits for a busy machine is lost in a crash.
    result.set_defaults(rt_priority=PRIORITY)
    result.add_argument(
        "--out",
        type=Path,
        required=True,
        help=f"directory for {FILE_NAME}, or log-2.mcap… if there is one",
    )
    add_recording_options(result)
    return result


def add_recording_options(to: argparse.ArgumentParser) -> None:
    """Add what can be chosen about a recording."""
    group = to.add_argument_group("recording")
    group.add_argument("--compression", choices=["zstd", "lz4", "none"], help="of the file (zstd)")
    group.add_argument(
        "--rotate-size", metavar="SIZE", help="begin a new part at this size, e.g. 2GB"
    )
    group.add_argument(
        "--rotate-every", metavar="TIME", help="begin a new part after this long, e.g. 10min"
    )
    group.add_argument(
        "--topics",
        metavar="PATTERNS",
        help="record only these, by commas, without the robot's name: 'plant/*,wbc/**'",
    )
    group.add_argument(
        "--exclude", metavar="PATTERNS", help="do not record these: 'camera/**,journal/*'"
    )
    group.add_argument(
        "--no-cameras", action="store_true", help="the same as --exclude 'camera/**'"
    )
    group.add_argument(
        "--observer",
        "--quiet",
        action="store_true",
        help="publish nothing at all, not even the logger's health; always so for a client",
    )


def settings_of(arguments: argparse.Namespace, table: dict[str, Any]) -> LoggerConfig:
    """The file's table with the options laid over it.

    Raises:
        ConfigError: a value is wrong.
    """
    settings = dict(table)
    try:
        if arguments.compression is not None:
            settings["compression"] = arguments.compression
        if arguments.rotate_size is not None:
            settings["rotate_size"] = parse_size(arguments.rotate_size)
        if arguments.rotate_every is not None:
            settings["rotate_every"] = parse_duration(arguments.rotate_every)
    except LoggerError as error:
        raise ConfigError(str(error)) from error
    if arguments.topics is not None:
        settings["topics"] = split_list(arguments.topics)
    if arguments.exclude is not None:
        settings["exclude"] = split_list(arguments.exclude)
    if arguments.no_cameras:
        settings["exclude"] = (*settings.get("exclude", ()), "camera/**")
    try:
        return LoggerConfig.model_validate(settings)
    except ValidationError as error:
        raise ConfigError(f"the logger's configuration is wrong: {explain(error)}") from error


def main(argv: Sequence[str] | None = None) -> int:
    """Record; exit code 0 after a signal, 1 after an error, 2 for a wrong configuration."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
    arguments = parser().parse_args(argv)
    stop = StopSignals().heed()
    try:
        bus, _, runtime, table = load_settings(arguments, LoggerService.name)
        config = settings_of(arguments, table)
        is_client = bus.mode == "client"
        order = Order(
            bus,
            arguments.out / FILE_NAME,
            config,
            observe=arguments.observer or is_client,
            ask=is_client and "robot" not in bus.model_fields_set,
            live=sys.stderr.isatty(),
            realtime=enter_realtime(runtime.rt_priority),
        )
        report = record(order, lambda: stop.asked)
    except ConfigError as error:
        print(f"logger: {error}", file=sys.stderr)
        return 2
    except TrillError as error:
        print(f"logger: {error}", file=sys.stderr)
        return 1
    print(format_report(report))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
