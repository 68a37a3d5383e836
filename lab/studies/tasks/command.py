"""The command line of ``python -m lab.studies.tasks``."""

import argparse
from pathlib import Path

from common.errors import ConfigError
from common.program import run_program
from common.runtime.live.main import OptionFormatter
from lab.studies.tasks.table import line, summary
from lab.trials import options
from lab.trials.links import chosen_links
from lab.trials.shown import run_shown
from lab.trials.spec import TrialSpec
from services.sim.tasks import all_tasks

EXAMPLES = """examples:
  python -m lab.studies.tasks run door/unlock --seeds 0:25 --jobs 2
  python -m lab.studies.tasks run bench/hammer --seeds 3 --link both=250ms
  python -m lab.studies.tasks run hardware/tool --seeds 3 --link none   without the task's own link
  python -m lab.studies.tasks run all --seeds 0:100 --jobs 2 --out runs/studies/tasks.jsonl
  python -m lab.studies.tasks pictures all --out docs/tasks

With --out a run may be stopped or killed, and the same command continues it; all tasks with 100
seeds take hours. A task may have a link of its own (the hardware/ tasks: command=paper), which
holds unless --link is given.

The exit code is 0 when every trial was a success, 1 when not, 2 when an option is wrong, 130 after
Ctrl-C.
"""


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    main = argparse.ArgumentParser(
        prog="python -m lab.studies.tasks",
        description="Scored tasks done by the synthetic operator, in simulated time.",
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = main.add_subparsers(dest="command", required=True)
    run = commands.add_parser(
        "run",
        help="run trials and print a table",
        description="Run trials of one task (or all) and print success, partial and failure.",
        formatter_class=OptionFormatter,
    )
    _trial_options(run)
    options.add_executor_options(run, default_jobs="1")
    run.add_argument(
        "--out",
        type=Path,
        help="keep each trial here as a line of JSON; trials that are there are not run again",
    )
    pictures = commands.add_parser(
        "pictures",
        help="draw a success of a task, or of every task",
        description="Run trials, seed after seed, until one is a success, and draw its key moments "
        "as one picture, from outside and from the robot's left camera. If there is no success, "
        "the last trial is drawn.",
        formatter_class=OptionFormatter,
    )
    _trial_options(pictures)
    pictures.add_argument("--view", type=int, choices=[0, 1, 2], help="one of the scene's cameras")
    pictures.add_argument(
        "--out", type=Path, default=Path("runs/studies/pictures"), help="directory or file name"
    )
    return main


def _trial_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("task", choices=["all", *all_tasks()], help="name of the task")
    parser.add_argument(
        "--seeds", type=options.seed_range, default="0:5", help="for instance 7 or 0:25"
    )
    options.add_trial_options(parser)
    options.add_link_options(parser)


def specs(arguments: argparse.Namespace) -> list[TrialSpec]:
    """Return the trials that the options ask for.

    Raises:
        ConfigError: a link is not understood.
    """
    links, settings = chosen_links(arguments.link), options.trial_settings(arguments)
    tasks = list(all_tasks()) if arguments.task == "all" else [arguments.task]
    return [
        TrialSpec(task=task, seed=seed, links=links, raw_hands=arguments.raw_hands, **settings)
        for task in tasks
        for seed in arguments.seeds
    ]


def run(arguments: argparse.Namespace) -> int:
    """Run the trials with a progress bar and print the table; returns 0 if all succeeded."""
    results = run_shown(
        specs(arguments), arguments.out, arguments.jobs, arguments.ray, lambda _, r: line(r)
    )
    print(summary(results))
    return 0 if all(result.verdict == "success" for result in results) else 1


def pictures(arguments: argparse.Namespace) -> int:
    """Draw a success of each task; returns 1 if a task had none."""
    from lab.monitor.tasks_text import sheet_name
    from lab.studies.tasks.pictures import check_picture_path, record_trial, write_sheet

    out: Path = arguments.out
    if out.suffix and arguments.task == "all":
        raise ConfigError(f"--out: expected a directory for several tasks, got {out}")
    trials = specs(arguments)
    tasks = dict.fromkeys(trial.task for trial in trials)
    paths = {task: out if out.suffix else out / sheet_name(task) for task in tasks}
    for path in paths.values():
        check_picture_path(path)
    code = 0
    for task, path in paths.items():
        for trial in (trial for trial in trials if trial.task == task):
            result, timeline = record_trial(trial)
            print(line(result), flush=True)
            if result.verdict == "success":
                break
        else:
            code = 1
        write_sheet(result, timeline, path, arguments.view)
        print(f"{path}  {path.stat().st_size / 1000:.0f} kB", flush=True)
    return code


def main(argv: list[str] | None = None) -> int:
    """Run the study; returns the exit code."""
    arguments = parser().parse_args(argv)
    work = pictures if arguments.command == "pictures" else run
    return run_program(
        "lab.studies.tasks", lambda: work(arguments), "stopped; with --out, what is done is kept"
    )
