"""The command line of ``python -m lab.studies.tasks``."""

import argparse
import sys
from pathlib import Path

from common.errors import ConfigError, TrillError
from common.runtime.live.main import OptionFormatter
from lab.studies.tasks.table import line, summary
from lab.trials.campaign import ResultStore, run_campaign
from lab.trials.links import HELP, chosen_links
from lab.trials.stack import TrialResult, TrialSpec
from services.sim.tasks import all_tasks
from services.teleop.synthetic.traits import TRAITS

EXAMPLES = """examples:
  python -m lab.studies.tasks run door/unlock --seeds 0:25 --jobs 2
  python -m lab.studies.tasks run bench/hammer --seeds 3 --link both=250ms
  python -m lab.studies.tasks run hardware/tool --seeds 3 --link none   without the task's own link
  python -m lab.studies.tasks run all --seeds 0:100 --jobs 2 --out runs/studies/tasks.jsonl
  python -m lab.studies.tasks film all --out docs/tasks

With --out a run may be ended or killed, and the same command goes on; all tasks with 100 seeds take
hours.
A task may have a link of its own (the hardware/ tasks: command=paper); it holds unless --link is
given.
The exit code is 0 when every trial was a success, 1 when not, 2 when an option is wrong, 130 after
Ctrl-C.
"""


def seed_range(text: str) -> range:
    """``7`` or ``0:25`` (the end is not included).

    Raises:
        argparse.ArgumentTypeError: neither of these.
    """
    first, colon, last = text.partition(":")
    try:
        seeds = range(int(first), int(last) if colon else int(first) + 1)
    except ValueError:
        seeds = range(0)
    if not seeds or seeds.start < 0:
        raise argparse.ArgumentTypeError(f"expected a seed or a range like 0:25, got {text!r}")
    return seeds


def parser() -> argparse.ArgumentParser:
    """The command line."""
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
    run.add_argument("task", choices=["all", *all_tasks()], help="which task")
    run.add_argument("--seeds", type=seed_range, default="0:5", help="for instance 0:25")
    run.add_argument("--jobs", type=int, default=1, help="trials at a time")
    run.add_argument(
        "--out",
        type=Path,
        help="keep each trial here as a line of JSON; what is there already is not run again",
    )
    _trial_options(run)
    film = commands.add_parser(
        "film",
        help="pictures of a success of a task, or of every task",
        description="Run trials, seed after seed, until one is a success, and write its telling "
        "moments as one picture, from outside and through the robot's eye. Without a success the "
        "last one is shown.",
        formatter_class=OptionFormatter,
    )
    film.add_argument("task", choices=["all", *all_tasks()], help="which task")
    film.add_argument("--seeds", type=seed_range, default="0:5", help="for instance 7 or 0:5")
    film.add_argument("--view", type=int, choices=[0, 1, 2], help="one of the scene's cameras")
    film.add_argument(
        "--out", type=Path, default=Path("runs/studies/films"), help="directory, or a file's name"
    )
    _trial_options(film)
    return main


def _trial_options(run: argparse.ArgumentParser) -> None:
    """Options about a trial itself."""
    run.add_argument("--traits", choices=list(TRAITS), default="practised", help="of the operator")
    run.add_argument(
        "--link",
        action="append",
        default=[],
        metavar="NAME=SPEC",
        help=HELP,
    )
    paces = ["fast", "normal", "slow", "public"]
    run.add_argument("--pace", choices=paces, default="", help="of the gaits")
    run.add_argument("--torque-mode", choices=["relaxed", "rated"], default="relaxed")
    run.add_argument("--raw-hands", action="store_true", help="no interpolation of the hands")
    run.add_argument(
        "--physics-steps",
        type=int,
        choices=range(1, 11),
        metavar="N",
        default=1,
        help="per step of the plant's service, 1 to 10; more: faster",
    )


def specs(arguments: argparse.Namespace) -> list[TrialSpec]:
    """The trials asked for.

    Raises:
        ConfigError: a link is not understood.
    """
    links = chosen_links(arguments.link)
    tasks = list(all_tasks()) if arguments.task == "all" else [arguments.task]
    return [
        TrialSpec(
            task=task,
            seed=seed,
            traits=TRAITS[arguments.traits],
            links=links,
            mode=arguments.torque_mode,
            pace=arguments.pace,
            raw_hands=arguments.raw_hands,
            physics_steps=arguments.physics_steps,
        )
        for task in tasks
        for seed in arguments.seeds
    ]


def run(arguments: argparse.Namespace) -> int:
    """Run the trials with a progress bar, print the table; 0 if all were a success."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TimeRemainingColumn

    trials, kept = specs(arguments), ResultStore(arguments.out)
    console = Console(stderr=True)
    there = sum(kept.of(trial) is not None for trial in trials)
    count = there

    def say(text: str) -> None:
        console.print(text, markup=False, highlight=False, soft_wrap=True)

    with Progress(
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        console=console,
        disable=not console.is_terminal,
    ) as progress:
        bar = progress.add_task("trials", total=len(trials), completed=there)

        def tell(result: TrialResult) -> None:
            nonlocal count
            count += 1
            progress.advance(bar)
            say(f"[{count}/{len(trials)}] {line(result)}")

        if there:
            say(f"{there} of {len(trials)} trials are in {kept.path} already")
        if kept.strange:
            say(f"{kept.strange} trials in {kept.path} were run by other code and do not count")
        results = run_campaign(trials, kept, arguments.jobs, tell, say)
    print(summary(results))
    return 0 if all(result.verdict == "success" for result in results) else 1


def film(arguments: argparse.Namespace) -> int:
    """Show a success of each task; 1 if one had none."""
    from lab.monitor.tasks_text import sheet_name
    from lab.studies.tasks.film import check_place, record, write_sheet

    out: Path = arguments.out
    if out.suffix and arguments.task == "all":
        raise ConfigError(f"--out: expected a directory for several tasks, got {out}")
    missed = False
    trials = specs(arguments)
    tasks = list(dict.fromkeys(trial.task for trial in trials))
    places = {task: out if out.suffix else out / sheet_name(task) for task in tasks}
    for path in places.values():
        check_place(path)
    for task, path in places.items():
        for trial in (trial for trial in trials if trial.task == task):
            result, moments = record(trial)
            print(line(result), flush=True)
            if result.verdict == "success":
                break
        missed = missed or result.verdict != "success"
        write_sheet(result, moments, path, arguments.view)
        print(f"{path}  {path.stat().st_size / 1000:.0f} kB", flush=True)
    return int(missed)


def main(argv: list[str] | None = None) -> int:
    """Run the study; returns the exit code."""
    arguments = parser().parse_args(argv)
    try:
        if arguments.command == "film":
            return film(arguments)
        return run(arguments)
    except TrillError as error:
        print(f"lab.studies.tasks: {error}", file=sys.stderr)
        return 2 if isinstance(error, ConfigError) else 1
    except KeyboardInterrupt:
        print("lab.studies.tasks: ended; with --out, what is done is kept", file=sys.stderr)
        return 130
