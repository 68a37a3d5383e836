"""``trill report``: the summary of a recorded run, written anew from its log."""

import argparse
from pathlib import Path

from deploy.system import LOG_FILE, RUNS
from lab.cli.commands import Action

TEXT = """Sum up a recorded run again from its log.mcap: write summary.json and contact_sheet.png
(and, with --video, video.mp4) into its directory and print the report. Works on logs cut off by a
crash."""
EXAMPLES = """examples:
  trill report runs/20260131-120000
  trill report runs/20260131-120000 --video
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill report``."""
    parser.add_argument(
        "run", type=Path, help=f"the run's directory, in {RUNS}/ as a rule, or its log"
    )
    parser.add_argument("--video", action="store_true", help="render video.mp4 too")


def run(arguments: argparse.Namespace) -> int:
    """Write summary and pictures and print the report; returns 0.

    Raises:
        LoggerError: the log cannot be read.
    """
    from deploy.launch import RunResult
    from lab.review.report import finish, known_verdict

    run: Path = arguments.run
    run_dir = run.parent if run.name == LOG_FILE else run
    verdict, settings = known_verdict(run_dir)
    finish(RunResult(run_dir, verdict), settings, pictures=True, video=arguments.video)
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
