"""``trill collect``: collect demonstrations of the synthetic operator, and inspect data sets."""

import argparse
import sys
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING

from common.errors import ConfigError
from common.packages import require
from lab.cli.commands import Action
from lab.cli.policy_task import say_other_task
from lab.trials import options

if TYPE_CHECKING:
    from lab.demonstrations.collect.config import EpisodeConfig

DATASETS = Path("runs/datasets")
_LATEST = 0.45
"""Part of a task's time limit after which a policy is helped: the rest is enough to finish it."""
TEXT = """Collect demonstrations of a task. A synthetic operator, a program with the hands, eyes and
delays of a person, does the task again and again in simulated time, each trial with a seed of its
own, until there are as many successes as asked for.

Each success becomes one HDF5 file of 20 Hz frames: pictures of both cameras, poses of feet and
hands, the controller's state and the joints; hands, grippers, gait and neck as the operator set
them; the robot time of each, and its age. Names, units and frames are in the file. With pictures of
400x300 a trial of door/unlock takes about 6 MB; the estimate for a run is printed at its beginning.

A run may be stopped or killed at any moment; the same command continues it. The bytes of the
episodes depend neither on that nor on --jobs. They depend in the last digits on the kind of
processor, which each episode names, and on this project's code: a data set that other code began is
not continued unless you accept that. A trial that fails is counted with its reason; its episode is
kept only with --keep-failures.

With --policy a policy does the task, and the operator takes over and finishes it when the policy
does not get on: so there are demonstrations from where this policy goes astray. An episode then has
the frames of both, and the column `intervention` says which are the operator's; training learns
from these alone. A trial in which the policy needed no help is no success here.

Exit code: 0 done, 1 not (too few successes, or errors in a data set), 2 wrong options, 130
Ctrl-C."""
EXAMPLES = f"""examples:
  trill tasks                                            list the tasks
  trill collect door/unlock --episodes 250 --jobs 2
  trill collect door/unlock --episodes 500 --jobs 2      250 more into the same data set
  trill collect door/unlock --link both=250ms --out {DATASETS}/late
  trill collect door/unlock --no-images --keep-failures --out {DATASETS}/states
  trill collect door/unlock --policy runs/policies/unlock/best --episodes 40 --seed 5000
  trill collect door/unlock --ray auto                   on a Ray cluster
  trill collect --info {DATASETS}/door-unlock
  trill collect --info {DATASETS}/door-unlock --sheet episode.png --episode 3
  trill collect --check {DATASETS}/door-unlock --remake 3
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill collect``."""
    add = parser.add_argument
    add("task", nargs="?", help="name of the task, as door/unlock; trill tasks lists them")
    add(
        "--episodes",
        type=options.count,
        default=10,
        metavar="N",
        help="number of successes, including those of an earlier run (10)",
    )
    options.add_executor_options(parser, default_jobs="1")
    add("--out", type=Path, metavar="DIR", help=f"the data set ({DATASETS}/<task>)")
    add(
        "--seed",
        type=options.seed,
        metavar="N",
        help="seed of the first trial, then upwards (0; for a data set that exists, its own)",
    )
    add(
        "--max-trials",
        type=options.count,
        metavar="N",
        help="give up after this number of trials (20 + 4 x --episodes)",
    )
    add(
        "--accept-changes",
        action="store_true",
        help="continue a data set that other code began; each episode says which code made it",
    )
    trial = parser.add_argument_group("settings of every trial")
    options.add_trial_options(trial)
    options.add_link_options(trial)
    trial.add_argument("--keep-failures", action="store_true", help="keep episodes that failed too")
    helped = parser.add_argument_group("help a policy (interventions, as in DAgger)")
    helped.add_argument("--policy", type=Path, metavar="CHECKPOINT", help="it does the task first")
    helped.add_argument(
        "--take-over",
        type=float,
        metavar="S",
        help="take over when the robot has not moved for so long (3)",
    )
    helped.add_argument(
        "--take-over-latest",
        type=float,
        metavar="S",
        help=f"take over in any case after so long ({_LATEST:g} of the task's time limit)",
    )
    pictures = parser.add_argument_group("pictures")
    pictures.add_argument("--width", type=int, default=400, metavar="N", help="[pixels] (400)")
    pictures.add_argument("--height", type=int, default=300, metavar="N", help="[pixels] (300)")
    pictures.add_argument(
        "--quality", type=int, default=90, metavar="N", help="JPEG quality, 1 to 100 (90)"
    )
    pictures.add_argument(
        "--no-images",
        action="store_true",
        help="make no pictures; they can be rendered later from the poses in the file",
    )
    look = parser.add_argument_group("inspect a data set instead of collecting")
    look.add_argument("--info", type=Path, metavar="DIR", help="trials, successes, failures, times")
    look.add_argument(
        "--sheet", type=Path, metavar="FILE.png", help="with --info: draw an episode as a picture"
    )
    look.add_argument("--episode", type=options.seed, metavar="SEED", help="with --sheet (first)")
    look.add_argument(
        "--check", type=Path, metavar="DIR", help="check every file, array, stamp and picture"
    )
    look.add_argument(
        "--remake",
        type=options.seed,
        metavar="SEED",
        help="with --check: make this trial again and compare the bytes",
    )
    look.add_argument(
        "--reindex", type=Path, metavar="DIR", help="rebuild index.jsonl from the files"
    )


def run(arguments: argparse.Namespace) -> int:
    """Collect, or inspect a data set; returns 0 or 1, or raises an exception of this project."""
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
        return _check(arguments.check, arguments.remake)
    if arguments.info is not None:
        return _show(arguments.info, arguments.episode, arguments.sheet)
    if arguments.reindex is not None:
        return _reindex(arguments.reindex)
    return _collect(arguments)


def _config(arguments: argparse.Namespace) -> "EpisodeConfig":
    from lab.demonstrations.collect.config import EpisodeConfig
    from lab.trials.links import chosen_links
    from services.sim.errors import TaskError

    def given(*names: str) -> dict[str, object]:
        return {name: getattr(arguments, name) for name in names}

    values = options.trial_settings(arguments) | given("task", "raw_hands", "keep_failures")
    times = (arguments.take_over, arguments.take_over_latest)
    if arguments.policy is None and times != (None, None):
        raise ConfigError("--take-over and --take-over-latest go with --policy")
    values["links"] = chosen_links(arguments.link)
    values["pictures"] = None if arguments.no_images else given("width", "height", "quality")
    try:
        if arguments.policy is not None:
            values["operator"] = _helped(arguments, values["operator"])
        return EpisodeConfig.checked(values)
    except TaskError as error:
        raise ConfigError(str(error)) from error


def _helped(arguments: argparse.Namespace, operator: object) -> dict[str, object]:
    """Return the policy that is helped by an operator, as settings of a trial."""
    require("trill collect --policy", "policy", "torch", "safetensors")
    from lab.learning.evaluation.plan import policy_spec
    from lab.trials.operators.specs import SyntheticSpec
    from services.policy.checkpoint.manifest import describe
    from services.sim.tasks import find_task

    assert isinstance(operator, SyntheticSpec)
    # A training that goes on moves its link to the best checkpoint.
    checkpoint = arguments.policy.resolve()
    description = describe(checkpoint)
    say_other_task(arguments.policy, description.manifest.origin.task, arguments.task)
    latest = arguments.take_over_latest
    if latest is None:
        latest = _LATEST * find_task(arguments.task).limit
    given = {"stalled": arguments.take_over, "latest": latest}
    return {
        "kind": "helped",
        "policy": policy_spec(checkpoint, description, {}),
        "traits": operator.traits,
        "take_over": {name: value for name, value in given.items() if value is not None},
    }


def _collect(arguments: argparse.Namespace) -> int:
    from lab.demonstrations.collect.collect import collect
    from lab.demonstrations.collect.progress import CollectionBar, closing
    from lab.demonstrations.collect.store import DatasetStore
    from lab.trials.executors import open_executor

    config = _config(arguments)
    name = config.task.replace("/", "-") + ("-interventions" if config.helped else "")
    root, began = arguments.out or DATASETS / name, monotonic()
    try:
        with CollectionBar() as bar:
            progress = collect(
                config,
                DatasetStore(root),
                lambda: open_executor(arguments.jobs, arguments.ray),
                wanted=arguments.episodes,
                first_seed=arguments.seed,
                max_trials=arguments.max_trials or 20 + 4 * arguments.episodes,
                accept_changes=arguments.accept_changes,
                on_progress=bar.update,
                on_message=bar.say,
            )
    except KeyboardInterrupt:
        print(f"\nstopped; {root} is kept: the same command continues it", file=sys.stderr)
        raise
    print(closing(progress, monotonic() - began), file=sys.stderr)
    print(root)
    return 0 if progress.complete else 1


def _show(root: Path, seed: int | None, sheet: Path | None) -> int:
    """Print what is in a data set; draw the episode with this seed (None: the first)."""
    from rich.console import Console

    from lab.demonstrations.collect.info import table, write_sheet
    from lab.demonstrations.collect.store import DatasetStore

    Console().print(table(DatasetStore(root).index()), markup=False)
    if sheet is not None:
        drawn = write_sheet(root, seed, sheet)
        print(f"{sheet}: the episode with seed {drawn}")
    return 0


def _reindex(root: Path) -> int:
    """Rebuild the index from the files."""
    from lab.demonstrations.collect.store import DatasetStore
    from lab.progress import ProgressBar

    store = DatasetStore(root)
    # First, so that no lock is left in a directory that is no data set.
    store.config()
    with store.locked(), ProgressBar("reading", len(store.files())) as bar:
        lines = store.scan(bar.advance)
        store.write_index(lines)
    print(f"{root}: {len(lines)} trials in the index")
    return 0


def _check(root: Path, seed: int | None) -> int:
    """Check every file, and make the trial with ``seed`` again; returns 1 if anything is wrong."""
    from lab.demonstrations.collect.check import check, remake
    from lab.demonstrations.collect.store import DatasetStore
    from lab.progress import ProgressBar

    store = DatasetStore(root)
    files = store.files()
    with ProgressBar("checking", len(files)) as bar:
        problems = check(store, bar.advance)
    if seed is not None:
        problems += filter(None, [remake(store, seed)])
    for problem in problems:
        print(problem)
    again = "" if seed is None else f", seed {seed} made again"
    print(f"{root}: {len(files)} trials read{again}; {len(problems) or 'nothing'} wrong")
    return 1 if problems else 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
