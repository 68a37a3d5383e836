"""The subcommand ``trill study``: what latency does to an operator."""

import argparse
import os
from pathlib import Path
from typing import TYPE_CHECKING

from common.errors import ConfigError
from deploy.extras import require
from lab.cli import study_human
from lab.cli.commands import Action, Command, add_commands, run_chosen
from lab.trials import options

if TYPE_CHECKING:
    from rich.console import Console

    from lab.studies.latency.plan import Plan
    from lab.studies.latency.store import Store

ROOT = Path("runs/studies/latency")
TEXT = """The latency study: what control latency and interpolation of the hands' set-points do to
completion time, success and workload. `latency` runs it with the synthetic operator, in simulated
time, and reports; `add` takes in trials of persons from their logs, `tlx` their answers on
workload. The two kinds of operator are never pooled."""
EXAMPLES = """examples:
  trill study latency --episodes 25 --jobs 2
  trill study add runs/20260131-120000 --participant P01 --condition interpolation
  trill study tlx --participant P01 --task door/unlock --condition interpolation
  trill study latency --report runs/studies/latency
  trill study latency --help                       likewise add, tlx
"""
LATENCY = """The synthetic operator does two manipulation tasks under four conditions, with the same
seeds in each: raw input (hand set-points go to the controller as they come), interpolation (the
final set-up), and this with 250 and 500 ms of injected control latency. In simulated time; each
trial is run once. What was really injected is measured where the messages were used.

Every trial that has ended is kept, whenever the study is stopped or killed: the same command goes
on, and more --episodes add seeds. Tasks, conditions and the system's source must be the same.

Written: trials.csv (a row a trial), summary.csv and summary.json (a row a condition), latency.png.
Printed: the summary, and whether the shape of the paper's result is there, by stated criteria.

With --episodes 0 only the directory is begun, for sessions of persons (trill study add, tlx).

Exit code: 0 all trials there, whatever they show; 1 not; 2 wrong options; 130 Ctrl-C."""
LATENCY_EXAMPLES = f"""examples:
  trill study latency --episodes 25 --jobs 2
  trill study latency --episodes 50 --jobs 2                     25 more of each
  trill study latency --direction both --out {ROOT}-both         late there and back
  trill study latency --tasks hardware/tool --condition raw --condition interpolation \\
      --out {ROOT}-tool
  trill study latency --condition interpolation --condition slow=command=100ms,feedback=50ms \\
      --condition "jumpy=command=lognormal(122ms, 190ms) corr=10s,raw" --out {ROOT}-mine
  trill study latency --report {ROOT}              tables and figure anew, no trials
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the subcommands of ``trill study``."""
    add_commands(parser, (LATENCY_COMMAND, *study_human.commands(ROOT)), "study", "study")


def run(arguments: argparse.Namespace) -> int:
    """Run the study that was asked for; 0, 1, or an exception of this project."""
    require("trill study", "study", "mujoco", "pinocchio", "scipy")
    return run_chosen(arguments, "study")


def _latency_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--episodes",
        type=options.seed,
        default=25,
        help="seeds in each condition of each task (25)",
    )
    options.add_executor_options(parser, default_jobs="one for each processor")
    parser.add_argument("--out", type=Path, default=ROOT, help=f"directory ({ROOT})")
    parser.add_argument(
        "--report", type=Path, metavar="DIR", help="only write tables and figure of DIR anew"
    )
    what = parser.add_argument_group("what is compared")
    what.add_argument("--tasks", nargs="+", metavar="TASK", help="which (door/unlock bench/hammer)")
    what.add_argument(
        "--direction",
        default="command",
        help="which way is late: command (operator to robot, as the paper's control latency; "
        "standard), feedback, or both (each by the whole latency)",
    )
    what.add_argument(
        "--condition",
        action="append",
        default=[],
        metavar="CONDITION",
        help="raw, interpolation, latency-250, latency-500 (standard: these four), or one of your "
        "own, NAME=LINK=SPEC,LINK=SPEC[,raw] or NAME=none; may be given again",
    )
    same = parser.add_argument_group("settings of every trial")
    same.add_argument(
        "--seed", type=options.seed, default=0, help="seed of the first trial, then upwards (0)"
    )
    options.add_trial_options(same)


def _plan(arguments: argparse.Namespace) -> "Plan":
    from lab.studies.latency.conditions import chosen
    from lab.studies.latency.plan import DEFAULT_TASKS, Plan
    from services.sim.errors import TaskError

    values = options.trial_settings(arguments) | {
        "tasks": tuple(arguments.tasks or DEFAULT_TASKS),
        "conditions": chosen(arguments.condition, arguments.direction),
        "first_seed": arguments.seed,
    }
    try:
        return Plan.checked(values)
    except TaskError as error:
        raise ConfigError(f"--tasks: {error}") from error


def _latency(arguments: argparse.Namespace) -> int:
    from rich.console import Console

    from lab.studies.latency.figure import pyplot
    from lab.studies.latency.store import Store

    # Before hours of trials, not after.
    pyplot()

    console = Console(stderr=True)
    if arguments.report is not None:
        return _report(Store(arguments.report))
    store = Store(arguments.out)
    try:
        _run(arguments, store, console)
    except KeyboardInterrupt:
        text = f"\nended; what is done is in {store.root}: the same command goes on from there"
        console.print(text, markup=False, highlight=False, soft_wrap=True)
        raise
    if arguments.episodes == 0:
        print(f"{store.root}: ready for trials of persons")
        return 0
    return _report(store)


def _run(arguments: argparse.Namespace, store: "Store", console: "Console") -> None:
    from lab.studies.latency.progress import Display
    from lab.studies.latency.run import run_study
    from lab.trials.executors import open_executor

    jobs = arguments.jobs or len(os.sched_getaffinity(0))
    with Display(console) as display:
        run_study(
            _plan(arguments),
            store,
            lambda: open_executor(arguments.jobs, arguments.ray, jobs),
            episodes=arguments.episodes,
            jobs=jobs,
            on_progress=display.update,
            on_message=display.say,
        )


def _report(store: "Store") -> int:
    from rich.console import Console

    from lab.studies.latency.report import write_report
    from lab.studies.latency.tables import LEGEND, closing, summary_table, workload_table

    report = write_report(store)
    if report is None:
        raise ConfigError(f"no trial and no sheet in {store.root} yet: run or add some first")
    console = Console()
    # A table cut to a pipe's 80 columns would lose its figures.
    if not console.is_terminal:
        console = Console(width=190)
    console.print(summary_table(report.plan, report.cells))
    console.print(LEGEND, style="dim", highlight=False)
    if report.workload:
        console.print()
        console.print(workload_table(report.plan, report.workload))
    console.print()
    console.print(closing(report.finding))
    console.print(f"{store.root}: {', '.join(report.files)}", markup=False, highlight=False)
    return 0


LATENCY_COMMAND = Command(
    "latency",
    "completion time and success under latency",
    Action(LATENCY, LATENCY_EXAMPLES, _latency_options, _latency),
)
ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
