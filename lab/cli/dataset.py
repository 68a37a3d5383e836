"""The subcommand ``trill dataset``: from recorded runs, and to the formats of other projects."""

import argparse
import sys
from importlib import import_module
from pathlib import Path
from typing import TYPE_CHECKING, Any

from common.errors import ConfigError
from common.packages import require
from lab.cli.commands import Action, Command, add_commands, run_chosen
from lab.trials.options import whole_number

if TYPE_CHECKING:
    from lab.demonstrations.export.selection import ExportInput

TEXT = """Make episodes of recorded runs, beside those of `trill collect`, and export demonstrations
for other projects' training code."""
EXAMPLES = """examples:
  trill dataset add runs/20260131-120000 --out runs/datasets/door-by-hand
  trill dataset export runs/datasets/door-unlock --format lerobot
  trill dataset export --help
"""
EXPORT = """Export one or several data sets of `trill collect` as one data set of another format,
which that project's own loader reads. Numbers are the collected ones as float32. The export
contains the names of all columns, the cameras' matrices and poses, and each episode's seed, verdict
and operator.

lerobot     a directory in format v3.0: observation.state (112 numbers: feet and hands, grippers,
            joints, controller state), action (18: hands, grippers, gait, neck),
            observation.images.left and right as mp4 or inside the tables, ages, success, the
            task's goal as a sentence, statistics to normalise by; meta/modality.json for GR00T.
robomimic   one HDF5 file: obs/robot0_left_eef_pos, robot0_left_eef_quat_wxyz, robot0_joint_vel,
            robot0_left_camera_image, actions, rewards, dones, and masks train and valid (a tenth);
            and a configuration beside it, with which robomimic trains. Pictures are raw, as
            robomimic requires: 100 frames of 400x300 take 72 MB, so give a --width. Actions are
            scaled to -1 ... 1, within which its policies act. Algorithms that learn a value (iql,
            td3_bc) need --next-obs.

--state chooses the measurements, for policies that take few numbers: hands,grippers are 16, feet,
hands,grippers,controller 31. --gait chooses the form of the gait: its number in the one frame that
asks for it (request), in all frames until it has been walked (held), or a column for each gait
(one-hot, held-one-hot).

Only successes are exported, up to the judge's verdict: what the operator does afterwards is no
demonstration of the task. The export is written whole or not at all.

Exit code: 0 done, 1 not, 2 wrong options, 130 Ctrl-C."""
EXPORT_EXAMPLES = """examples:
  trill dataset export runs/datasets/door-unlock --format lerobot
  trill dataset export runs/datasets/door-unlock runs/datasets/door-push --format lerobot \\
    --out runs/datasets/door-lerobot --width 224 --height 224
  trill dataset export runs/datasets/door-walk --format lerobot --pictures embedded --gait held \\
    --state hands,feet,grippers,controller
  trill dataset export runs/datasets/door-unlock --format robomimic --width 120
  trill dataset export runs/datasets/door-unlock --format robomimic --pictures none --seeds 0:50 \\
    --next-obs
"""
FORMATS = ("lerobot", "robomimic")
PICTURES = ("video", "embedded", "none")
GAITS = ("request", "held", "one-hot", "held-one-hot")
_LEROBOT_CRF = 18
_PIXELS = whole_number(16, 1920)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``trill dataset``."""
    export = Action(EXPORT, EXPORT_EXAMPLES, _export_options, _export)
    commands = (
        Command("add", "make episodes of recorded runs", "lab.cli.dataset_add:ACTION"),
        Command("export", "for lerobot or robomimic", export),
    )
    add_commands(parser, commands, "dataset", "action")


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen subcommand; returns 0, or raises an exception of this project."""
    return run_chosen(arguments, "dataset")


def _export_options(export: argparse.ArgumentParser) -> None:
    export.add_argument("dirs", nargs="+", type=Path, metavar="DIR", help="made by trill collect")
    export.add_argument("--format", required=True, choices=FORMATS, help="format of the export")
    export.add_argument("--out", type=Path, help="directory or file to write (DIR-FORMAT)")
    export.add_argument("--force", action="store_true", help="replace an earlier export")
    which = export.add_argument_group("selection")
    which.add_argument(
        "--seeds", type=_range, default=(None, None), metavar="A:B", help="seeds from A, below B"
    )
    which.add_argument(
        "--failures", action="store_true", help="also kept episodes that are no success"
    )
    which.add_argument("--tail", action="store_true", help="also frames after the verdict")
    pictures = export.add_argument_group("pictures")
    pictures.add_argument("--width", type=_PIXELS, help="scale to this; alone: in proportion")
    pictures.add_argument("--height", type=_PIXELS, help="scale to this height")
    pictures.add_argument(
        "--pictures",
        choices=PICTURES,
        help="lerobot: video (default), or embedded in the tables without loss; robomimic: "
        "embedded; or none",
    )
    pictures.add_argument(
        "--crf",
        type=whole_number(0, 51),
        help=f"video quality, 0 best to 51 ({_LEROBOT_CRF})",
    )
    pictures.add_argument(
        "--compress", action="store_true", help="robomimic: half the size, slower to train from"
    )
    numbers = export.add_argument_group("numbers")
    numbers.add_argument(
        "--state",
        type=lambda text: tuple(text.split(",")),
        metavar="PART,...",
        help="measurements: feet, hands, grippers, joints, velocities, controller (all)",
    )
    numbers.add_argument(
        "--gait", choices=GAITS, default=GAITS[0], help=f"form of the gait ({GAITS[0]})"
    )
    robomimic = export.add_argument_group("robomimic")
    robomimic.add_argument(
        "--scale-actions",
        action=argparse.BooleanOptionalAction,
        help="map each column to -1 ... 1 by its range, which the file contains (on)",
    )
    robomimic.add_argument(
        "--next-obs",
        action="store_true",
        help="also the observations after each action; doubles the size",
    )


def _range(text: str) -> tuple[int | None, int | None]:
    parts = text.split(":")
    if len(parts) != 2 or not all(part.isdecimal() or not part for part in parts):
        raise argparse.ArgumentTypeError(f"expected two seeds as 0:50, got {text!r}")
    first, end = (int(part) if part else None for part in parts)
    return first, end


def _export(arguments: argparse.Namespace) -> int:
    form, options = arguments.format, _format_options(arguments)
    packages = ("av", "cv2", "h5py", "pyarrow") if form == "lerobot" else ("cv2", "h5py")
    extra = "lerobot" if form == "lerobot" else "collect"
    require(f"trill dataset export --format {form}", extra, *packages)
    from lab.demonstrations.export.fields import ExportColumns
    from lab.demonstrations.export.selection import EpisodeSelection, select_episodes
    from lab.progress import ProgressBar

    parts = {} if arguments.state is None else {"parts": arguments.state}

    selection = EpisodeSelection(
        roots=tuple(arguments.dirs),
        seeds=arguments.seeds,
        failures=arguments.failures,
        tail=arguments.tail,
        width=arguments.width,
        height=arguments.height,
        pictures=arguments.pictures != "none",
        columns=ExportColumns(gait=arguments.gait, **parts),
    )
    out = arguments.out or _beside(arguments.dirs, form)
    source = select_episodes(selection)
    module = import_module(f"lab.demonstrations.export.{form}")
    with ProgressBar("episodes", len(source.episodes)) as bar:
        given = {"force": arguments.force, "on_episode": bar.advance} | options
        notes = module.write(source, out, **given)
    for note in (*source.notes, *notes):
        print(f"note: {note}", file=sys.stderr)
    _print_summary(source, out, module.how_to_use(out))
    return 0


def _format_options(arguments: argparse.Namespace) -> dict[str, Any]:
    """Return the options of the format's ``write``.

    Raises:
        ConfigError: an option belongs to the other format, or to pictures that are left out.
    """
    given = {
        "--crf": arguments.crf is not None,
        "--compress": arguments.compress,
        "--scale-actions": arguments.scale_actions is not None,
        "--next-obs": arguments.next_obs,
    }
    robomimic = ("--compress", "--scale-actions", "--next-obs")
    theirs = robomimic if arguments.format == "lerobot" else ("--crf",)
    wrong = [name for name in theirs if given[name]]
    if wrong:
        raise ConfigError(f"{wrong[0]} is not for {arguments.format}; leave it out")
    if arguments.pictures == "none" and (arguments.width or arguments.height):
        raise ConfigError(
            "--width and --height are for pictures; leave them or --pictures none out"
        )
    if arguments.format == "robomimic":
        if arguments.pictures == "video":
            raise ConfigError("robomimic reads no video: expected --pictures embedded or none")
        return {
            "compress": arguments.compress,
            "scale_actions": arguments.scale_actions is not False,
            "next_obs": arguments.next_obs,
        }
    video = arguments.pictures in {None, "video"}
    if given["--crf"] and not video:
        raise ConfigError("--crf is for video; leave it out, or --pictures")
    crf = arguments.crf if arguments.crf is not None else _LEROBOT_CRF
    return {"video": video, "crf": crf}


def _beside(dirs: list[Path], form: str) -> Path:
    if len(dirs) > 1:
        raise ConfigError("expected --out, since there are several data sets")
    root: Path = dirs[0].resolve()
    return root.with_name(f"{root.name}-{form}" + (".hdf5" if form == "robomimic" else ""))


def _print_summary(source: "ExportInput", out: Path, use: str) -> None:
    files = [path for path in out.rglob("*") if path.is_file()] if out.is_dir() else [out]
    size = sum(path.stat().st_size for path in files)
    pictures = f"pictures {source.size[0]}x{source.size[1]}" if source.size else "no pictures"
    print(
        f"{len(source.episodes)} episodes of {', '.join(source.tasks)}: {source.frames} frames, "
        f"{pictures}, {size * 1e-6:.1f} MB, by {', '.join(source.operators)} operator"
    )
    print(use)
    print(out)


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
