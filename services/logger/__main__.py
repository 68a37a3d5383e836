"""``python -m services.logger``: record everything on the bus."""

import argparse
import logging
import sys
from collections.abc import Sequence
from pathlib import Path

from pydantic import ValidationError

from common.errors import ConfigError, TrillError, explain
from common.runtime.main import argument_parser, load_settings
from common.runtime.realtime import enter_realtime
from services.logger.config import LoggerConfig
from services.logger.parts import next_part
from services.logger.service import LoggerService, Stopper, record
from services.logger.tally import format_report

FILE_NAME = "log.mcap"


def parser() -> argparse.ArgumentParser:
    """The command line."""
    result = argument_parser(
        LoggerService.name,
        "Record every message on the robot's bus to one MCAP file, as the very bytes that were "
        "sent, until Ctrl-C. Prints how many messages of each topic were recorded, dropped and "
        "missing. A killed logger loses less than a second; the file stays readable.",
        # Recording must never take the processor from the control loop, and records every message
        # when it arrives.
        background=True,
        delayable=False,
    )
    result.add_argument(
        "--out",
        type=Path,
        required=True,
        help=f"directory for {FILE_NAME}, or log-2.mcap… if there is one",
    )
    result.add_argument("--compression", choices=["zstd", "lz4", "none"], help="of the file")
    return result


def main(argv: Sequence[str] | None = None) -> int:
    """Record; exit code 0 after a signal, 1 after an error, 2 for a wrong configuration."""
    logging.basicConfig(level=logging.INFO, format="%(asctime)s %(name)s: %(message)s")
    arguments = parser().parse_args(argv)
    stopper = Stopper()
    try:
        bus, _, runtime, settings = load_settings(arguments, LoggerService.name)
        if arguments.compression is not None:
            settings = {**settings, "compression": arguments.compression}
        try:
            config = LoggerConfig.model_validate(settings)
        except ValidationError as error:
            raise ConfigError(f"the logger's configuration is wrong: {explain(error)}") from error
        realtime = enter_realtime(runtime.rt_priority)
        report, lost = record(bus, next_part(arguments.out / FILE_NAME), config, stopper, realtime)
    except ConfigError as error:
        print(f"logger: {error}", file=sys.stderr)
        return 2
    except TrillError as error:
        print(f"logger: {error}", file=sys.stderr)
        return 1
    print(format_report(report))
    if lost:
        print(f"{lost} more messages were lost while the logger stood still")
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
