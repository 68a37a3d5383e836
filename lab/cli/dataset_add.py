"""``trill dataset add``: make episodes of recorded runs."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING

from common.packages import require
from lab.cli.collect import DATASETS
from lab.cli.commands import Action
from lab.cli.log_argument import HELP, chosen_log

if TYPE_CHECKING:
    from common.episodes.episode_file import EpisodeMeta

TEXT = """Make episodes of recorded runs, in the format of `trill collect`: what a person, a script
or a policy did with `trill up --task` or `trill demo --task`, from the log alone. Training, export
and `trill collect --info` and --check take them like all others.

A take is a trial of the task, from the first set-point until half a second after the judge's
verdict; or, where the recording has marks (`trill mark`), what lies between them. Takes that were
discarded, and failures, are listed and not kept. A take that is in the data set already is not
added again.

If a policy had the robot and a person or script took over, the column `intervention` says whose
each frame is, and training learns what the person did. Episodes of persons, of scripts, of policies
and of both together are not put into one data set unless --mix is given.

Exit code: 0 done, 1 not, 2 wrong options, 130 Ctrl-C."""
EXAMPLES = f"""examples:
  trill dataset add runs/20260131-120000 --out {DATASETS}/door-by-hand
  trill dataset add runs/2026013* --out {DATASETS}/door-by-hand --trim-idle
  trill collect --info {DATASETS}/door-by-hand --sheet episode.png
  trill train door/unlock --data {DATASETS}/door-unlock --data {DATASETS}/door-by-hand
"""


def _add_options(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("logs", type=Path, nargs="+", metavar="RUN", help=HELP)
    add("--out", type=Path, required=True, metavar="DIR", help="the data set; it may be there")
    add("--task", help="the task that was done, where the recording has no judge's verdict")
    add("--mix", action="store_true", help="episodes of several kinds of operators in one data set")
    add(
        "--trim-idle",
        action="store_true",
        help="leave out rest at the beginning and the end, but for half a second",
    )
    add("--keep-failures", action="store_true", help="keep episodes that failed too")


def _add(arguments: argparse.Namespace) -> int:
    """Add all runs; returns 0, or raises an exception of this project."""
    require("trill dataset add", "collect", "cv2", "h5py", "mujoco", "pinocchio")
    require("trill dataset add", "logger", "mcap")
    from lab.demonstrations.collect.store import DatasetStore
    from lab.demonstrations.recorded.add import AddOptions, add_run
    from lab.progress import ProgressBar

    options = AddOptions(
        arguments.task, arguments.mix, arguments.trim_idle, arguments.keep_failures
    )
    store = DatasetStore(arguments.out)
    for path in arguments.logs:
        log = chosen_log(path)
        with ProgressBar(str(path)) as bar:
            added = add_run(log, store, options, bar.show)
        known = f"; {added.known} were there already" if added.known else ""
        print(f"{path}: {len(added.metas)} takes{known}")
        print("\n".join(_lines(added.metas)) or "  nothing new")
    print(arguments.out)
    return 0


def _lines(metas: "Iterable[EpisodeMeta]") -> list[str]:
    return [
        f"  episode {one.seed}: {one.task} by {one.operator}, {one.frames} frames, "
        f"{one.verdict}: {one.reason}"
        for one in metas
    ]


ACTION = Action(TEXT, EXAMPLES, _add_options, _add)
