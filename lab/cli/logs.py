"""The subcommands about logs: record, info, repair, mark."""

import argparse
import contextlib
import json
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

from common.errors import TrillError
from common.schemas import EpisodeAction
from common.transport.config import BusConfig, bus_config, read_config_file, split_list
from deploy.system import LOG_FILE, RUNS, new_run_dir
from lab.cli import ledger
from lab.cli.commands import Command
from services.logger.__main__ import add_recording_options, settings_of
from services.logger.read.reader import LogReader

RECORD = """Record everything on a running system's bus until Ctrl-C, and nothing else. Beside the
robot no option is needed. From another machine --connect is enough: robots and topics are found by
asking, topics this version does not know are recorded with the schema their sender describes, and
nothing at all is published. At the end the account of each topic is printed: sent = recorded +
lost on the way + dropped here."""
RECORD_EXAMPLES = """examples:
  trill record
  trill record --connect tcp/robot:7447             as a guest, from another machine
  trill record --connect tcp/robot:7447 --robot draco3 --no-cameras
  trill record --rotate-size 2GB --rotate-every 10min
  trill record --topics 'plant/*,wbc/**' --out logs/friday
"""
INFO = """Say what is in a log: when and where it was recorded, which services ran, each topic's
messages, rate, size and losses, the episodes, the injected links, and whether the file is whole.
Only the index is read, so it is quick; a file without its end is read through."""
INFO_EXAMPLES = f"""examples:
  trill info {RUNS}/20260131-120000
  trill info {RUNS}/20260131-120000/log-2.mcap       only this part
  trill info log.mcap --json
"""
REPAIR = """Make a log whole whose recorder was killed, whose disk was full, or that is damaged: all
chunks that can be read and what is left of the last are written anew, with index, schemas, episodes
and account. The result takes the file's place only when it is complete and read back; the broken
file stays beside it as .broken. A whole file is not touched. Of a recording in several parts each
is seen to."""
REPAIR_EXAMPLES = f"""examples:
  trill repair {RUNS}/20260131-120000
  trill repair log.mcap --out saved.mcap            leave log.mcap as it is
  trill repair log.mcap --discard-original          when the disk has no room for both
"""
MARK = """Mark the start and the end of an episode in a running recording, for instance one attempt
at a task. Numbers follow one another by themselves. The command returns when every recorder of the
robot has the mark; if none is there it fails, since the mark would be lost."""
MARK_EXAMPLES = """examples:
  trill mark start --label 'open the door'
  trill mark end
  trill mark discard --label 'hand slipped'
  trill mark start --connect tcp/robot:7447
"""

TABLES: dict[str, Callable[[LogReader], str]] = {"ledger": ledger.as_text}
"""Further tables of ``trill info --table``, by name; each reads the log and returns its text."""


def _bus_arguments(parser: argparse.ArgumentParser, what: str) -> None:
    parser.add_argument("--config", type=Path, help="TOML file for the whole stack")
    parser.add_argument("--robot", help="its name (draco3, or TRILL_ROBOT; a guest asks)")
    parser.add_argument(
        "--base-port", type=int, help=f"of the system {what} (7448, or TRILL_BASE_PORT)"
    )
    parser.add_argument(
        "--connect",
        metavar="ENDPOINT",
        help="come as a guest to this endpoint, e.g. tcp/robot:7447 (or TRILL_CONNECT)",
    )


def _record_arguments(parser: argparse.ArgumentParser) -> None:
    _bus_arguments(parser, "to record")
    parser.add_argument("--out", type=Path, help="directory for log.mcap (a new one in runs/)")
    add_recording_options(parser)


def _record(arguments: argparse.Namespace) -> int:
    # First, so that a wrong option leaves no empty directory.
    _bus(arguments)
    settings_of(arguments, {})
    options = {
        "--config": arguments.config,
        "--robot": arguments.robot,
        "--base-port": arguments.base_port,
        "--connect": arguments.connect,
        "--mode": "client" if arguments.connect else None,
        "--out": arguments.out or new_run_dir(),
        "--compression": arguments.compression,
        "--rotate-size": arguments.rotate_size,
        "--rotate-every": arguments.rotate_every,
        "--topics": arguments.topics,
        "--exclude": arguments.exclude,
    }
    given = [text for name, value in options.items() if value for text in (name, str(value))]
    given += ["--no-cameras"] * arguments.no_cameras + ["--observer"] * arguments.observer
    # In place of this process, so that Ctrl-C and kill reach the logger itself.
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "services.logger", *given])


def _info_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, help=f"a run's directory, in {RUNS}/ as a rule, or a log")
    parser.add_argument("--json", action="store_true", help="for a program")
    parser.add_argument(
        "--table", choices=sorted(TABLES) or None, help="read the log and show this as well"
    )


def _info(arguments: argparse.Namespace) -> int:
    from lab.logs.log_text import as_json, info_lines
    from services.logger.read.info import read_info

    path = _log_file(arguments.log)
    info = read_info(path)
    if arguments.json:
        print(json.dumps(as_json(info), indent=2))
        return 0
    print("\n".join(info_lines(info)))
    if arguments.table is not None:
        if arguments.table not in TABLES:
            raise TrillError(f"no table {arguments.table!r}; expected one of {sorted(TABLES)}")
        print(f"\n{TABLES[arguments.table](LogReader(path))}")
    return 0


def _repair_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, help="a run's directory or a log, all its parts")
    parser.add_argument("--out", type=Path, help="write here and leave the log as it is")
    parser.add_argument(
        "--discard-original", action="store_true", help="do not keep the broken file as .broken"
    )


def _repair(arguments: argparse.Namespace) -> int:
    from lab.logs.log_text import repair_lines
    from services.logger.read.segments import existing_segments, segment
    from services.logger.repair.repair import repair

    code = 0
    for number, path in enumerate(existing_segments(_log_file(arguments.log)), start=1):
        out = None if arguments.out is None else segment(arguments.out, number)
        try:
            with _bar(path.name) as progress:
                done = repair(
                    path, out, discard_original=arguments.discard_original, on_progress=progress
                )
        except TrillError as error:
            print(f"trill: {error}", file=sys.stderr)
            code = 1  # the other parts may be better
            continue
        print("\n".join(repair_lines(done)))
    return code


def _mark_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["start", "end", "discard"])
    parser.add_argument("--label", default="", help="task, condition, remark")
    _bus_arguments(parser, "to mark")


def _mark(arguments: argparse.Namespace) -> int:
    from lab.logs.mark import mark

    print(mark(_bus(arguments), EpisodeAction[arguments.action.upper()], arguments.label))
    return 0


def _bus(arguments: argparse.Namespace) -> BusConfig:
    """The bus as a guest if --connect is given, else as a part of the system.

    Raises:
        ConfigError: the file, an option or an environment variable is wrong.
    """
    config: Path | None = arguments.config
    if config is None and os.environ.get("TRILL_CONFIG"):
        config = Path(os.environ["TRILL_CONFIG"])
    given = {"base_port": arguments.base_port, "robot": arguments.robot}
    if arguments.connect:
        given |= {"connect": split_list(arguments.connect), "mode": "client"}
    return bus_config(read_config_file(config).get("bus") if config else None, given)


def _log_file(path: Path) -> Path:
    return path / LOG_FILE if path.is_dir() else path


@contextlib.contextmanager
def _bar(name: str) -> Iterator[Callable[[int, int], None]]:
    """A progress bar on a terminal, nothing elsewhere."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(name, total=None)
        yield lambda done, size: bar.update(task, completed=done, total=size)


COMMANDS = (
    Command(
        "record",
        "only record a running system",
        RECORD,
        RECORD_EXAMPLES,
        _record_arguments,
        _record,
    ),
    Command("info", "what is in a log", INFO, INFO_EXAMPLES, _info_arguments, _info),
    Command(
        "repair", "make a broken log whole", REPAIR, REPAIR_EXAMPLES, _repair_arguments, _repair
    ),
    Command("mark", "start or end of an episode", MARK, MARK_EXAMPLES, _mark_arguments, _mark),
)
