"""``trill eval``: how often a policy succeeds in a scored task."""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import ConfigError
from common.packages import require
from lab.cli.commands import Action
from lab.trials import options

if TYPE_CHECKING:
    from lab.learning.evaluation.summary import Start, Trial
    from lab.trials.operators.specs import PolicySpec
    from lab.trials.spec import TrialResult, TrialSpec

ROOT = Path("runs/evaluations")
HELD_OUT = "0:25"
TEXT = """Evaluate a policy: trials of a scored task in simulated time, the policy the operator.
Start, noise and links come from the seed. Seeds 0:25 are held out: demonstrations use seeds from
1000 on. A policy that sees gets the pictures that live cameras would give it, at the same ages.

Every trial that has ended is kept as a line of JSON, with the whole configuration, the checkpoint's
digest and the versions of the code. Stopped or killed, the same command goes on; more --seeds add
trials. Printed: success and partial success with 95 % intervals, median time, the time in which
nothing moved, falls, and what became of each trial that was no success.

Two baselines get rows of their own: --blind shows the policy the mean pictures of a data set, so
the difference is what its eyes are worth; --constant answers with the data set's mean action.

Exit code: 0 all trials are there, whatever they show; 1 not; 2 wrong options; 130 Ctrl-C."""
EXAMPLES = """examples:
  trill eval runs/policies/door-unlock/best
  trill eval runs/policies/door-unlock/best --seeds 0:100 --jobs 2 --videos runs/failures
  trill eval CHECKPOINT --blind runs/datasets/door-unlock --constant
  trill eval CHECKPOINT --link command=250ms             a late link
  trill eval CHECKPOINT --serve compensate=false --serve trigger.level=0.5
  python -m lab.studies.tasks run door/unlock --seeds 0:25 --physics-steps 5 --link none \\
      --out runs/operator.jsonl
  trill eval CHECKPOINT --operator runs/operator.jsonl   how much longer than the operator
  trill study policies                                   tables of everything in runs/evaluations
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill eval``."""
    parser.add_argument("checkpoint", type=Path, metavar="CHECKPOINT", help="its folder")
    what = parser.add_argument_group("what is run")
    what.add_argument(
        "--task", help="name of the task (the one of the demonstrations; see: trill tasks)"
    )
    what.add_argument(
        "--seeds", type=options.seed_range, metavar="A:B", help=f"of the trials ({HELD_OUT})"
    )
    what.add_argument(
        "--trials", type=options.count, metavar="N", help="in place of --seeds: 0:N (25)"
    )
    what.add_argument(
        "--blind", type=Path, metavar="DATASET", help="also: shown only its mean pictures"
    )
    what.add_argument(
        "--constant", action="store_true", help="also: the mean action as the only answer"
    )
    options.add_link_options(what)
    options.add_robot_options(what, physics_steps=5)
    how = parser.add_argument_group("how the policy is run")
    how.add_argument(
        "--serve",
        action="append",
        default=[],
        metavar="NAME=VALUE",
        help="a field of PolicyConfig, for instance execute=3 (docs/reference/configuration.md)",
    )
    how.add_argument("--label", default="", help="name of its row (what sets the policy apart)")
    options.add_executor_options(parser.add_argument_group("workers"), default_jobs="1")
    out = parser.add_argument_group("what is written")
    out.add_argument("--out", type=Path, metavar="FILE", help=f"lines of JSON ({ROOT}/...)")
    out.add_argument(
        "--operator", type=Path, metavar="FILE", help="trials to compare the times with"
    )
    out.add_argument(
        "--videos", type=Path, metavar="DIR", help="a video of each failure, and a contact sheet"
    )


def run(arguments: argparse.Namespace) -> int:
    """Evaluate; returns 0, or raises an exception of this project."""
    require("trill eval", "study", "cv2", "mujoco", "pinocchio", "rich", "scipy")
    require("trill eval", "policy", "torch", "safetensors")
    from rich.console import Console

    from lab.learning.evaluation.summary import label_of, summarise
    from lab.learning.evaluation.text import result_text, rows_text
    from lab.trials.shown import run_shown

    if arguments.seeds is not None and arguments.trials is not None:
        raise ConfigError("expected --seeds or --trials, got both")
    trials, out = _trials(arguments)
    operator = _operator_times(arguments.operator, trials)

    def line(spec: "TrialSpec", result: "TrialResult") -> str:
        return f"{label_of(spec)}: {result_text(result)}"

    try:
        results = run_shown(trials, out, arguments.jobs, arguments.ray, line)
    except KeyboardInterrupt:
        print(f"\nstopped; {out} is kept: the same command continues it", file=sys.stderr)
        raise
    done = list(zip(trials, results, strict=True))
    console = Console()
    # A table cut to the 80 columns of a pipe would lose its numbers.
    if not console.is_terminal:
        console = Console(width=160)
    console.print(rows_text(summarise(done, operator)))
    print(out)
    if arguments.videos is not None:
        _film(arguments, done)
    return 0


def _trials(arguments: argparse.Namespace) -> tuple[list["TrialSpec"], Path]:
    """Return the trials to be run, and the file that keeps them."""
    from lab.learning.evaluation.plan import policy_spec, serving_options
    from lab.trials.links import chosen_links
    from lab.trials.spec import TrialSpec
    from services.policy.checkpoint.manifest import describe
    from services.sim.errors import TaskError
    from services.sim.tasks import find_task

    # A training that goes on moves its link to the best checkpoint.
    checkpoint = arguments.checkpoint.resolve()
    description = describe(checkpoint)
    task = arguments.task or description.manifest.origin.task
    if not task:
        raise ConfigError(
            "expected --task: the checkpoint does not say which task it was trained for"
        )
    try:
        find_task(task)
    except TaskError as error:
        raise ConfigError(f"--task: {error}") from error
    serving = serving_options(arguments.serve)
    spec = policy_spec(checkpoint, description, serving, arguments.label)
    name = f"{task.replace('/', '-')}-{description.digest[:12]}"
    out = arguments.out or ROOT / f"{name}.jsonl"
    settings = options.robot_settings(arguments) | {
        "task": task,
        "links": chosen_links(arguments.link),
        "raw_hands": arguments.raw_hands,
    }
    seeds = arguments.seeds or range(arguments.trials or options.seed_range(HELD_OUT).stop)
    return [
        TrialSpec(operator=operator, seed=seed, **settings)
        for operator in _operators(arguments, spec, out)
        for seed in seeds
    ], out


def _operators(arguments: argparse.Namespace, spec: "PolicySpec", out: Path) -> list["PolicySpec"]:
    """Return the policy and its baselines."""
    from lab.learning.evaluation.mean_pictures import mean_pictures
    from lab.learning.evaluation.plan import blind, constant
    from lab.progress import ProgressBar

    operators = [spec]
    if arguments.blind is not None:
        with ProgressBar("mean pictures") as bar:
            pictures = mean_pictures(arguments.blind, out.with_suffix(".mean.png"), bar.show)
        operators.append(blind(spec, pictures))
    if arguments.constant:
        operators.append(constant(spec))
    return operators


def _operator_times(path: Path | None, trials: Sequence["TrialSpec"]) -> dict["Start", float]:
    """Return the completion times to compare with."""
    from lab.learning.evaluation.summary import success_times
    from lab.trials.results import read_records

    if path is None:
        return {}
    wanted = {(trial.task, trial.seed) for trial in trials}
    times = success_times((record.spec, record.result) for record in read_records(path))
    if not any(start[:2] in wanted for start in times):
        raise ConfigError(
            f"--operator: {path} has no success of {trials[0].task} with these seeds; make them "
            f"with: python -m lab.studies.tasks run {trials[0].task} --out {path}"
        )
    return times


def _film(arguments: argparse.Namespace, done: Sequence["Trial"]) -> None:
    from lab.learning.evaluation.films import film_failures
    from lab.progress import ProgressBar
    from lab.trials.executors import open_executor

    failures = sum(result.verdict != "success" for _, result in done)
    with ProgressBar("videos", failures) as bar:
        sheet = film_failures(
            done,
            arguments.videos,
            lambda: open_executor(arguments.jobs, arguments.ray),
            on_film=lambda path: bar.advance(str(path)),
            on_message=bar.say,
        )
    print("no failure to film" if sheet is None else sheet)


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
