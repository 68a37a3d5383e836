"""The subcommand ``trill collect``: demonstrations by the hundred from the synthetic operator."""

import argparse
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Any

from common.errors import ConfigError
from deploy.extras import require
from lab.cli.collected import check_files, reindex, show_info
from lab.cli.commands import Command

if TYPE_CHECKING:
    from lab.demonstrations.collect.executors import Executor
    from lab.demonstrations.collect.recipe import EpisodeConfig

DATASETS = Path("runs/datasets")
TEXT = """Collect demonstrations of a task: a synthetic operator (a program with human-like hands,
eyes and delays, no person) does it again and again in simulated time, each trial with a seed of its
own, until there are as many successes as asked for.

Each success becomes one HDF5 file of 20 Hz frames: pictures of both eyes, poses of feet and hands,
the controller's state, the joints; hands, grippers, gait and neck as the operator set them; the
robot time of each and how old it was. Names, units and frames are in the file. With pictures of
400x300 a trial of door/unlock is about 6 MB; what a run will take is told before it begins.

A run can be ended or killed at any moment; the same command goes on where it was. The episodes, to
the byte, depend on neither that nor --jobs nor the machine. They do depend on this project's code:
a data set begun by other code is not continued unless you accept it. A trial that fails is counted
with its reason; its episode is kept only with --keep-failures.

Exit code: 0 all there, 1 not (too few successes, something wrong in a data set), 2 wrong options,
130 Ctrl-C."""
EXAMPLES = f"""examples:
  trill tasks                                            the tasks there are
  trill collect door/unlock --episodes 250 --jobs 2
  trill collect door/unlock --episodes 500 --jobs 2      250 more into the same data set
  trill collect door/unlock --link both=250ms --out {DATASETS}/late
  trill collect door/unlock --no-images --keep-failures --out {DATASETS}/states
  trill collect door/unlock --ray auto                   on a Ray cluster
  trill collect --info {DATASETS}/door-unlock
  trill collect --info {DATASETS}/door-unlock --sheet episode.png --episode 3
  trill collect --check {DATASETS}/door-unlock --remake 3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill collect``."""
    add = parser.add_argument
    add("task", nargs="?", help="which task, as door/unlock; trill tasks lists them")
    add(
        "--episodes",
        type=_positive,
        default=10,
        metavar="N",
        help="successes wanted, those of an earlier run counted (10)",
    )
    add(
        "--jobs",
        type=_positive,
        metavar="N",
        help="trials at a time, a process each (1; Ray: as many as the cluster has processors)",
    )
    add("--out", type=Path, metavar="DIR", help=f"the data set ({DATASETS}/<task>)")
    add(
        "--seed",
        type=_seed,
        metavar="N",
        help="of the first trial, then one up (0; of a data set that is there: its own)",
    )
    add(
        "--max-trials",
        type=_positive,
        metavar="N",
        help="give up after so many (20 + 4 x --episodes)",
    )
    add(
        "--accept-changes",
        action="store_true",
        help="go on with a data set that other code began; each episode says which code made it",
    )
    add("--ray", metavar="ADDRESS", help="a Ray cluster: auto, HOST:PORT or ray://HOST:PORT")
    _made_from(parser.add_argument_group("what an episode is made from"))
    eyes = parser.add_argument_group("pictures")
    eyes.add_argument("--width", type=int, default=400, metavar="N", help="pixels (400)")
    eyes.add_argument("--height", type=int, default=300, metavar="N", help="pixels (300)")
    eyes.add_argument("--quality", type=int, default=90, metavar="N", help="of JPEG, 1-100 (90)")
    eyes.add_argument(
        "--no-images",
        action="store_true",
        help="none; they can be rendered later from the poses in the file",
    )
    look = parser.add_argument_group("look at a data set, instead of collecting")
    look.add_argument("--info", type=Path, metavar="DIR", help="trials, successes, failures, times")
    look.add_argument(
        "--sheet", type=Path, metavar="FILE.png", help="with --info: picture of an episode"
    )
    look.add_argument("--episode", type=_seed, metavar="SEED", help="of which (the first)")
    look.add_argument(
        "--check",
        type=Path,
        metavar="DIR",
        help="read every file, array, stamp and picture and say what is wrong",
    )
    look.add_argument(
        "--remake",
        type=_seed,
        metavar="SEED",
        help="with --check: make that one again and compare the bytes",
    )
    look.add_argument(
        "--reindex", type=Path, metavar="DIR", help="write index.jsonl anew from the files"
    )


def _made_from(group: "argparse._ArgumentGroup") -> None:
    group.add_argument(
        "--traits",
        default="practised",
        metavar="NAME",
        help="of the operator: practised (standard), or steady, without tremor or aiming errors",
    )
    group.add_argument(
        "--link",
        action="append",
        default=[],
        metavar="NAME=SPEC",
        help="injected "
        "delay, as both=250ms (see: trill latency --help); replaces the task's own (hardware/: "
        "command=paper); none: no delay",
    )
    group.add_argument(
        "--torque-mode",
        default="relaxed",
        metavar="MODE",
        help="torque limits: relaxed (standard) or rated, the real motors'",
    )
    group.add_argument(
        "--pace", default="", help="of the gaits: fast, normal, slow, public (normal; rated: slow)"
    )
    group.add_argument(
        "--raw-hands",
        action="store_true",
        help="the controller does not interpolate the hand set-points",
    )
    group.add_argument(
        "--physics-steps",
        type=int,
        default=1,
        metavar="N",
        help="of 1 ms between "
        "two looks at the bus, 1 to 5; 5 is faster, the robot hears commands later (1)",
    )
    group.add_argument("--keep-failures", action="store_true", help="keep their episodes, too")


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f"expected a number from 1 up, got {text!r}")
    return int(text)


def _seed(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"expected a seed from 0 up, got {text!r}")
    return int(text)


def run(arguments: argparse.Namespace) -> int:
    """Do what was asked for; 0, 1, or an exception of this project."""
    require("trill collect", "collect", "cv2", "h5py", "mujoco", "pinocchio", "scipy")
    asked = [arguments.task, arguments.info, arguments.reindex, arguments.check]
    if sum(value is not None for value in asked) != 1:
        raise ConfigError(
            "expected a task, --info DIR, --check DIR or --reindex DIR; see trill collect --help"
        )
    if arguments.info is None and (arguments.sheet or arguments.episode is not None):
        raise ConfigError("--sheet and --episode go with --info DIR")
    if arguments.episode is not None and arguments.sheet is None:
        raise ConfigError("--episode says which one --sheet draws: give both")
    if arguments.check is None and arguments.remake is not None:
        raise ConfigError("--remake goes with --check DIR")
    if arguments.check is not None:
        return check_files(arguments.check, arguments.remake)
    if arguments.info is not None:
        return show_info(arguments.info, arguments.episode, arguments.sheet)
    if arguments.reindex is not None:
        return reindex(arguments.reindex)
    return _collect(arguments)


def _recipe(arguments: argparse.Namespace) -> "EpisodeConfig":
    from lab.demonstrations.collect.recipe import EpisodeConfig
    from lab.trials.links import chosen_links
    from services.sim.errors import TaskError
    from services.teleop.synthetic.traits import TRAITS

    if arguments.traits not in TRAITS:
        raise ConfigError(f"--traits: expected {' or '.join(TRAITS)}, got {arguments.traits!r}")
    values: dict[str, Any] = {
        name: getattr(arguments, name)
        for name in ("task", "torque_mode", "pace", "raw_hands", "physics_steps", "keep_failures")
    }
    values["traits"] = TRAITS[arguments.traits]
    values["links"] = chosen_links(arguments.link)
    eyes = {name: getattr(arguments, name) for name in ("width", "height", "quality")}
    try:
        return EpisodeConfig.checked(values | {"eyes": None if arguments.no_images else eyes})
    except TaskError as error:
        raise ConfigError(str(error)) from error


def _crew(arguments: argparse.Namespace, recipe: "EpisodeConfig") -> "Executor":
    from lab.demonstrations.collect.executors import LocalExecutor, RayExecutor

    if arguments.ray:
        return RayExecutor(recipe, arguments.ray, arguments.jobs)
    return LocalExecutor(recipe, arguments.jobs or 1)


def _collect(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from lab.demonstrations.collect.collect import collect
    from lab.demonstrations.collect.progress import Display, closing
    from lab.demonstrations.collect.store import Store

    recipe = _recipe(arguments)
    root = arguments.out or DATASETS / recipe.task.replace("/", "-")
    console, began = Console(stderr=True), monotonic()
    try:
        with Display(console) as display:
            standing = collect(
                recipe,
                Store(root),
                lambda: _crew(arguments, recipe),
                wanted=arguments.episodes,
                first_seed=arguments.seed,
                max_trials=arguments.max_trials or 20 + 4 * arguments.episodes,
                accept_changes=arguments.accept_changes,
                tell=display.tell,
                say=display.say,
            )
    except KeyboardInterrupt:
        text = f"\nended; what is done is in {root}: the same command goes on from there"
        console.print(text, markup=False, highlight=False, soft_wrap=True)
        raise
    text = closing(standing, monotonic() - began)
    console.print(text, markup=False, highlight=False, soft_wrap=True)
    print(root)
    return 0 if standing.complete else 1


COMMAND = Command(
    "collect",
    "demonstrations of a task by the hundred",
    TEXT,
    EXAMPLES,
    add_arguments,
    run,
)
