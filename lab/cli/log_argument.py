"""The argument LOG of all commands that read a log."""

import argparse
import sys
from pathlib import Path

from deploy.system import LOG_FILE, RUNS
from services.logger.errors import LoggerError

HELP = f"an MCAP file, or the directory of a run, in {RUNS}/ as a rule: its {LOG_FILE}"


def add_log_argument(parser: argparse.ArgumentParser) -> None:
    """Add LOG, the log to read with all its segments."""
    parser.add_argument("log", type=Path, metavar="LOG", help=HELP)


def chosen_log(given: Path, *, tell: bool = True) -> Path:
    """Return the first segment's path of the log that ``given``, a file or directory, names.

    With ``tell`` missing segments and files of other recordings beside it are told.

    Raises:
        LoggerError: the directory has no log of a run.
    """
    from services.logger.read.segments import find_segments

    path = given / LOG_FILE if given.is_dir() else given
    found = find_segments(path)
    if given.is_dir() and not found.paths[0].exists():
        others = ", ".join(sorted(file.name for file in given.glob("*.mcap"))) or "no MCAP file"
        raise LoggerError(
            f"cannot open the log of {given}: expected {LOG_FILE} in it, got {others}; name the "
            "file itself"
        )
    for remark in found.remarks() if tell else ():
        print(f"trill: {remark}", file=sys.stderr)
    return path
