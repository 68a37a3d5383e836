"""``trill study``: the effect of latency on an operator, and policies beside one another."""

import argparse
import os
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import ConfigError
from common.packages import require
from lab.cli.commands import Action, Command, add_commands, run_chosen
from lab.cli.study_human import COMMANDS, ROOT
from lab.trials import options

if TYPE_CHECKING:
    from lab.studies.latency.plan import Plan
    from lab.studies.latency.store import StudyStore

TEXT = """The latency study: how control latency and the interpolation of hand set-points change
completion time, success and workload. `latency` runs it with the synthetic operator in simulated
time and writes the report; `add` adds trials of persons from their logs, `tlx` their answers on
workload. The two kinds of operator are never pooled.

`policies` tables the policies that trill eval has evaluated, and can train and evaluate all kinds
first."""
EXAMPLES = """examples:
  trill study latency --episodes 25 --jobs 2
  trill study add runs/20260131-120000 --participant P01 --condition interpolation
  trill study tlx --participant P01 --task door/unlock --condition interpolation
  trill study latency --report runs/studies/latency
  trill study policies
  trill study latency --help                       likewise add, tlx, policies
"""
LATENCY = """The synthetic operator does two manipulation tasks under four conditions, with the same
seeds in each: raw input (the controller does not interpolate hand set-points), interpolation (the
final set-up), and this with 250 and 500 ms of injected control latency. Trials run in simulated
time, each once. The latency is measured where the messages were used.

Every trial that has ended is kept when the study is stopped or killed: the same command continues
it, and more --episodes add seeds. Tasks, conditions and the system's source must be the same.

Written: trials.csv (a row for each trial), summary.csv and summary.json (a row for each condition),
latency.png. Printed: the summary, and whether the shape of the paper's result is there, by stated
criteria.

With --episodes 0 only the directory is begun, for sessions of persons (trill study add, tlx).

Exit code: 0 all trials are there, whatever they show; 1 not; 2 wrong options; 130 Ctrl-C."""
LATENCY_EXAMPLES = f"""examples:
  trill study latency --episodes 25 --jobs 2
  trill study latency --episodes 50 --jobs 2                     25 more of each
  trill study latency --direction both --out {ROOT}-both         delay in both directions
  trill study latency --tasks hardware/tool --condition raw --condition interpolation \\
      --out {ROOT}-tool
  trill study latency --condition interpolation --condition slow=command=100ms,feedback=50ms \\
      --condition "jumpy=command=lognormal(122ms, 190ms) corr=10s,raw" --out {ROOT}-mine
  trill study latency --report {ROOT}              tables and figure again, no trials
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``trill study``."""
    add_commands(parser, (LATENCY_COMMAND, *COMMANDS, POLICIES_COMMAND), "study", "study")


def run(arguments: argparse.Namespace) -> int:
    """Run the chosen subcommand; returns 0 or 1, or raises an exception of this project."""
    require("trill study", "study", "matplotlib", "mujoco", "pinocchio", "scipy")
    return run_chosen(arguments, "study")


def _latency_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--episodes",
        type=options.seed,
        default=25,
        help="number of seeds in each condition of each task (25)",
    )
    options.add_executor_options(parser, default_jobs="one for each processor")
    parser.add_argument("--out", type=Path, default=ROOT, help=f"directory ({ROOT})")
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="only write tables and figure of DIR again"
    )
    what = parser.add_argument_group("what is compared")
    what.add_argument(
        "--tasks", nargs="+", metavar="TASK", help="names of the tasks (door/unlock bench/hammer)"
    )
    what.add_argument(
        "--direction",
        default="command",
        help="delayed direction: command (default; operator to robot, the paper's control "
        "latency), feedback, or both (each by the whole latency)",
    )
    what.add_argument(
        "--condition",
        action="append",
        default=[],
        metavar="CONDITION",
        help="raw, interpolation, latency-250, latency-500 (default: these four), or one of your "
        "own, NAME=LINK=SPEC,LINK=SPEC[,raw] or NAME=none; may be given several times",
    )
    same = parser.add_argument_group("settings of every trial")
    same.add_argument(
        "--seed", type=options.seed, default=0, help="seed of the first trial, then upwards (0)"
    )
    options.add_trial_options(same)


def _plan(arguments: argparse.Namespace) -> "Plan":
    from lab.studies.latency.conditions import chosen_conditions
    from lab.studies.latency.plan import DEFAULT_TASKS, Plan
    from services.sim.errors import TaskError

    values = options.trial_settings(arguments) | {
        "tasks": tuple(arguments.tasks or DEFAULT_TASKS),
        "conditions": chosen_conditions(arguments.condition, arguments.direction),
        "first_seed": arguments.seed,
    }
    try:
        return Plan.checked(values)
    except TaskError as error:
        raise ConfigError(f"--tasks: {error}") from error


def _latency(arguments: argparse.Namespace) -> int:
    from lab.studies.latency.store import StudyStore

    if arguments.report is not None:
        return _report(StudyStore(arguments.report))
    store = StudyStore(arguments.out)
    try:
        _run_trials(arguments, store)
    except KeyboardInterrupt:
        print(f"\nstopped; {store.root} is kept: the same command continues it", file=sys.stderr)
        raise
    if arguments.episodes == 0:
        print(f"{store.root}: ready for trials of persons")
        return 0
    return _report(store)


def _run_trials(arguments: argparse.Namespace, store: "StudyStore") -> None:
    from lab.progress import ProgressBar
    from lab.studies.latency.run import run_study, show_progress
    from lab.trials.executors import open_executor

    jobs = arguments.jobs or len(os.sched_getaffinity(0))
    with ProgressBar("trials") as bar:
        run_study(
            _plan(arguments),
            store,
            lambda: open_executor(arguments.jobs, arguments.ray, jobs),
            episodes=arguments.episodes,
            jobs=jobs,
            on_progress=partial(show_progress, bar),
            on_message=bar.say,
        )


def _report(store: "StudyStore") -> int:
    from rich.console import Console

    from lab.studies.latency.report import write_report
    from lab.studies.latency.tables import report_text

    report = write_report(store)
    if report is None:
        raise ConfigError(f"no trial and no sheet in {store.root} yet: run or add some first")
    console = Console()
    # A table cut to the 80 columns of a pipe would lose its numbers.
    if not console.is_terminal:
        console = Console(width=190)
    console.print(report_text(report))
    print(f"{store.root}: {', '.join(report.files)}")
    return 0


LATENCY_COMMAND = Command(
    "latency",
    "completion time and success under latency",
    Action(LATENCY, LATENCY_EXAMPLES, _latency_options, _latency),
)
POLICIES_COMMAND = Command(
    "policies", "policies, beside one another and the paper's", "lab.cli.study_policies:ACTION"
)
ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
