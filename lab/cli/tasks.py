"""``trill tasks``: describe the scored tasks and their scenes."""

import argparse
from pathlib import Path

from common.errors import ConfigError
from common.packages import require
from lab.cli.commands import Action

TEXT = """List the scored tasks: the goal, the time limit and the rule of success. With the name of
a task, show everything about it: stages, reasons to end, desired contacts, and the origin of its
start and its rule. With --physics, print the masses, frictions and springs of the scenes as
Markdown, each with its reason. With --pictures, draw every scene into a directory (needs EGL)."""
EXAMPLES = """examples:
  trill tasks
  trill tasks door/unlock
  trill tasks --physics > physics.md
  trill tasks --pictures docs/tasks
  trill demo --task door/unlock --seed 7                     see it done, live
  python -m lab.studies.tasks pictures all --out docs/tasks  draw a success of each task
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill tasks``."""
    parser.add_argument("name", nargs="?", help="show everything about this task")
    parser.add_argument("--physics", action="store_true", help="print masses and frictions")
    parser.add_argument("--pictures", type=Path, metavar="DIR", help="draw the scenes into DIR")


def run(arguments: argparse.Namespace) -> int:
    """Print what was asked for; returns exit code 0.

    Raises:
        ConfigError: there is no such task, or MuJoCo is not installed.
        LabError: the pictures cannot be written.
        RenderingUnavailableError: off-screen OpenGL is not available.
    """
    require("trill tasks", "sim", "mujoco")
    from rich.console import Console

    from lab.monitor.tasks_text import describe_task, draw_scenes, physics_table, task_table
    from services.sim.tasks import all_tasks

    console = Console(soft_wrap=arguments.physics)
    tasks = all_tasks()
    if arguments.physics:
        console.print(physics_table(), markup=False, highlight=False)
    elif arguments.pictures is not None:
        draw_scenes(console, arguments.pictures)
    elif arguments.name is None:
        console.print(task_table(list(tasks.values())))
    elif arguments.name in tasks:
        console.print(describe_task(tasks[arguments.name]), markup=False, highlight=False)
    else:
        raise ConfigError(f"unknown task {arguments.name!r}: expected one of {', '.join(tasks)}")
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
