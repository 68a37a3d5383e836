"""``python -m services.logger``: record everything on the bus."""

import argparse
import contextlib
import logging
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from common.errors import ConfigError, TrillError, report
from common.packages import imports_of
from common.runtime.live.main import argument_parser, load_settings
from common.runtime.live.realtime import enter_realtime
from common.runtime.live.stopping import StopSignals
from common.tables import validated

with imports_of("services.logger", "logger"):
    from services.logger.errors import LoggerError
    from services.logger.read.delivery import format_report
    from services.logger.record.config import LoggerConfig
    from services.logger.record.service import NAME, RecordingOptions, record
    from services.logger.record.units import parse_duration, parse_patterns, parse_size

FILE_NAME = "log.mcap"
PRIORITY = 1
"""Lowest priority of SCHED_FIFO."""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    result = argument_parser(
        NAME,
        "Record every message on the robot's bus to an MCAP file, byte by byte as it was sent, "
        "until Ctrl-C. Prints how many messages of each topic were sent, recorded, lost on the way "
        "and dropped. A killed logger loses less than a second; the file stays readable, and "
        "`trill repair` makes it whole.",
        # Settings of the control loop are not meant for the recorder, and its inputs have no links.
        background=True,
        delayable=False,
    )
    # Below every service of the robot, so that it never delays the control loop; above all other
    # processes, because what it could not write yet is lost in a crash.
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
    """Add the options of a recording."""
    group = to.add_argument_group("recording")
    group.add_argument(
        "--compression", choices=["zstd", "lz4", "none"], help="compression of the file (zstd)"
    )
    group.add_argument(
        "--rotate-size", metavar="SIZE", help="begin a new segment at this size, e.g. 2GB"
    )
    group.add_argument(
        "--rotate-every", metavar="TIME", help="begin a new segment after this time, e.g. 10min"
    )
    group.add_argument(
        "--keep-size",
        metavar="SIZE",
        help="delete the oldest segments when all take more than this, e.g. 50GB",
    )
    group.add_argument(
        "--keep-segments",
        type=int,
        metavar="N",
        help="delete the oldest segments when there are more",
    )
    group.add_argument(
        "--min-free",
        metavar="SIZE",
        help="end the recording, whole, when the disk has less space left (100MB)",
    )
    group.add_argument(
        "--topics",
        metavar="PATTERNS",
        help="record only these, without the robot's name, separated by commas or blanks, e.g. "
        "'plant/*,wbc/**'",
    )
    group.add_argument(
        "--exclude", metavar="PATTERNS", help="do not record these, e.g. 'camera/**,journal/*'"
    )
    group.add_argument(
        "--no-cameras", action="store_true", help="the same as --exclude 'camera/**'"
    )
    group.add_argument(
        "--observer",
        action="store_true",
        help="publish nothing at all, not even the logger's health; always so for a client",
    )


def settings_of(arguments: argparse.Namespace, table: dict[str, Any]) -> LoggerConfig:
    """Return the configuration file's table, overridden by the options.

    Raises:
        ConfigError: a value is wrong.
    """
    try:
        given = {
            "compression": arguments.compression,
            "rotate_size": arguments.rotate_size and parse_size(arguments.rotate_size),
            "rotate_every": arguments.rotate_every and parse_duration(arguments.rotate_every),
            "keep_size": arguments.keep_size and parse_size(arguments.keep_size),
            "keep_segments": arguments.keep_segments,
            "min_free": arguments.min_free and parse_size(arguments.min_free),
            "topics": arguments.topics and parse_patterns(arguments.topics),
            "exclude": arguments.exclude and parse_patterns(arguments.exclude),
        }
    except LoggerError as error:
        raise ConfigError(str(error)) from error
    settings = table | {name: value for name, value in given.items() if value is not None}
    if arguments.no_cameras:
        settings["exclude"] = (*settings.get("exclude", ()), "camera/**")
    return validated(LoggerConfig, settings)


def main(argv: Sequence[str] | None = None) -> int:
    """Record; return 0 after a signal, 1 after an error, 2 for a wrong configuration."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
    arguments = parser().parse_args(argv)
    stop = StopSignals().install()
    try:
        bus, _, runtime, table = load_settings(arguments, NAME)
        config = settings_of(arguments, table)
        is_client = bus.mode == "client"
        options = RecordingOptions(
            bus,
            arguments.out / FILE_NAME,
            config,
            observe=arguments.observer or is_client,
            find_robot=is_client and "robot" not in bus.model_fields_set,
            live=sys.stderr.isatty(),
            realtime=enter_realtime(runtime.rt_priority),
        )
        delivered = record(options, lambda: stop.requested)
    except TrillError as error:
        with contextlib.suppress(OSError):  # it stays if there is anything in it
            arguments.out.rmdir()
        return report("logger", error)
    print(format_report(delivered))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
