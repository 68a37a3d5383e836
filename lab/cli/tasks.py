"""The subcommand ``trill tasks``: what can be asked of the robot, and how it is scored."""

import argparse
from pathlib import Path

from common.errors import ConfigError
from lab.cli.commands import Command
from lab.errors import LabError

TEXT = """Show the scored tasks: what is to be done, in what time, and when it is a success. With
the name of one, everything about it: stages, what ends it, desired contacts, where start and rule
are from. With --physics the masses, frictions and springs of the scenes, each with its reason, as
Markdown. With --pictures draw every scene into a directory (needs EGL)."""
EXAMPLES = """examples:
  trill tasks
  trill tasks door/unlock
  trill tasks --physics > physics.md
  trill tasks --pictures docs/tasks
  trill demo --task door/unlock --seed 7                     see it done, live
  python -m lab.studies.tasks film all --out docs/tasks          pictures of a success of each
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill tasks``."""
    parser.add_argument("name", nargs="?", help="tell everything about this task")
    parser.add_argument("--physics", action="store_true", help="masses and frictions, Markdown")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes into DIR")


def run(arguments: argparse.Namespace) -> int:
    """Print what was asked for; 0, or an exception of this project."""
    # Here, so that every other command works where the plant's packages are not installed.
    try:
        from rich.console import Console

        from lab.monitor.tasks_text import describe, draw, physics_table, task_table
        from services.sim.tasks import all_tasks
    except ModuleNotFoundError as error:
        raise LabError(
            f"the scenes cannot be built without {error.name}: pip install 'trill[sim]'"
        ) from error
    console = Console(soft_wrap=arguments.physics)
    tasks = all_tasks()
    if arguments.physics:
        console.print(physics_table(), markup=False, highlight=False)
    elif arguments.pictures is not None:
        draw(console, arguments.pictures)
    elif arguments.name is None:
        console.print(task_table(list(tasks.values())))
    elif arguments.name in tasks:
        console.print(describe(tasks[arguments.name]), markup=False, highlight=False)
    else:
        raise ConfigError(f"unknown task {arguments.name!r}: expected one of {', '.join(tasks)}")
    return 0


COMMAND = Command("tasks", "the scored tasks", TEXT, EXAMPLES, add_arguments, run)
