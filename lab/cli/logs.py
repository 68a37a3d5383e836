"""The subcommands about logs: record, info, repair, mark."""

import argparse
import json
import os
import sys
from pathlib import Path

from common.errors import TrillError
from deploy.system import RUNS, new_run_dir
from lab.cli.bus import add_bus_options, chosen_bus
from lab.cli.commands import Action
from lab.cli.log_argument import add_log_argument, chosen_log

RECORD = """Record every message on the bus of a running system until Ctrl-C. Beside the robot no
option is needed. From another machine --connect is enough: the recorder asks for the robot's name
and topics, records topics that this version does not know with the schema their sender describes,
and publishes nothing. At the end it prints for each topic how many messages were sent = recorded +
lost on the way + dropped here.

A recording goes on in log-2.mcap … if its directory has one already. With --rotate-size or
--rotate-every it is written in segments; --keep-size and --keep-segments then delete the oldest."""
RECORD_EXAMPLES = """examples:
  trill record
  trill record --connect tcp/robot:7447             from another machine
  trill record --connect tcp/robot:7447 --robot draco3 --no-cameras
  trill record --rotate-size 2GB --rotate-every 10min
  trill record --rotate-size 2GB --keep-size 50GB   a ring of segments
  trill record --topics 'plant/*,wbc/**' --out logs/friday
"""
INFO = """Show what a log holds: when and where it was recorded, which services ran, each topic's
messages, rate, size and losses, who had the robot and where somebody took over from a policy, the
episodes, the injected links, and whether the file is whole.
This reads the index and little else, and is quick; a file without its end is read through."""
INFO_EXAMPLES = f"""examples:
  trill info {RUNS}/20260131-120000
  trill info {RUNS}/20260131-120000/log-2.mcap       only this segment
  trill info log.mcap --json
"""
REPAIR = """Repair a log whose recorder was killed, whose disk was full, or that is damaged. All
chunks that can be read, and what is left of the last one, are written to a new file with index,
schemas and delivery statistics. It replaces the log once it is complete and has been read back; the
broken file stays beside it as .broken. A whole file is not changed. All segments of a recording are
repaired. With --discard-original the broken file is not kept, unless fewer messages come out of it
than it should hold."""
REPAIR_EXAMPLES = f"""examples:
  trill repair {RUNS}/20260131-120000
  trill repair log.mcap --out saved.mcap            leave log.mcap as it is
  trill repair log.mcap --discard-original          when the disk has no room for both
"""
MARK = """Mark the start and the end of an episode in a running recording, for instance one attempt
at a task. Episodes are numbered automatically. The command returns when every recorder of the robot
has recorded the mark. Without a recorder it fails, because the mark would be lost."""
MARK_EXAMPLES = """examples:
  trill mark start --label 'open the door'
  trill mark end
  trill mark discard --label 'hand slipped'
  trill mark start --connect tcp/robot:7447
"""


def _record_arguments(parser: argparse.ArgumentParser) -> None:
    from services.logger.__main__ import add_recording_options

    add_bus_options(parser)
    parser.add_argument("--out", type=Path, help="directory of the new log.mcap (runs/<time>/)")
    add_recording_options(parser)


def _record(arguments: argparse.Namespace) -> int:
    from services.logger.__main__ import settings_of

    # Check the options first, so that a wrong one leaves no empty directory.
    chosen_bus(arguments)
    settings_of(arguments, {})
    options = {
        "--config": arguments.config,
        "--robot": arguments.robot,
        "--base-port": arguments.base_port,
        "--connect": ",".join(arguments.connect or ()),
        "--mode": "client" if arguments.connect else None,
        "--out": arguments.out or new_run_dir(),
        "--compression": arguments.compression,
        "--rotate-size": arguments.rotate_size,
        "--rotate-every": arguments.rotate_every,
        "--keep-size": arguments.keep_size,
        "--keep-segments": arguments.keep_segments,
        "--min-free": arguments.min_free,
        "--topics": arguments.topics,
        "--exclude": arguments.exclude,
    }
    given = [text for name, value in options.items() if value for text in (name, str(value))]
    given += ["--no-cameras"] * arguments.no_cameras + ["--observer"] * arguments.observer
    # The logger replaces this process, so that Ctrl-C and kill reach it directly.
    sys.stdout.flush()
    os.execv(sys.executable, [sys.executable, "-m", "services.logger", *given])


def _info_arguments(parser: argparse.ArgumentParser) -> None:
    add_log_argument(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def _info(arguments: argparse.Namespace) -> int:
    from lab.logs.log_text import as_json, info_lines
    from services.logger.read.info import read_info

    info = read_info(chosen_log(arguments.log, tell=False))
    if arguments.json:
        print(json.dumps(as_json(info), indent=2))
    else:
        print("\n".join(info_lines(info)))
    return 0


def _repair_arguments(parser: argparse.ArgumentParser) -> None:
    add_log_argument(parser)
    parser.add_argument("--out", type=Path, help="write here and leave the log unchanged")
    parser.add_argument(
        "--discard-original", action="store_true", help="do not keep the broken file as .broken"
    )


def _repair(arguments: argparse.Namespace) -> int:
    from lab.logs.log_text import repair_lines
    from lab.progress import ProgressBar
    from services.logger.read.segments import existing_segments
    from services.logger.repair.repair import repair

    code = 0
    first = chosen_log(arguments.log)
    for path in existing_segments(first):
        # The copies keep the numbers of the segments, so that a missing one stays missing.
        end = path.stem.removeprefix(first.stem)
        out = arguments.out and arguments.out.with_stem(f"{arguments.out.stem}{end}")
        try:
            with ProgressBar(path.name) as bar:
                done = repair(
                    path, out, discard_original=arguments.discard_original, on_progress=bar.show
                )
        except TrillError as error:
            print(f"trill: {error}", file=sys.stderr)
            code = 1  # the other segments may be readable
            continue
        print("\n".join(repair_lines(done)))
    return code


def _mark_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("action", choices=["start", "end", "discard"])
    parser.add_argument("--label", default="", help="task, condition or remark")
    add_bus_options(parser)


def _mark(arguments: argparse.Namespace) -> int:
    from common.schemas import EpisodeAction
    from lab.logs.mark import mark

    print(mark(chosen_bus(arguments), EpisodeAction[arguments.action.upper()], arguments.label))
    return 0


RECORD_ACTION = Action(RECORD, RECORD_EXAMPLES, _record_arguments, _record)
INFO_ACTION = Action(INFO, INFO_EXAMPLES, _info_arguments, _info)
REPAIR_ACTION = Action(REPAIR, REPAIR_EXAMPLES, _repair_arguments, _repair)
MARK_ACTION = Action(MARK, MARK_EXAMPLES, _mark_arguments, _mark)
