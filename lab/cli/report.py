"""``trill report``: the summary of a recorded run, written anew from its log."""

import argparse

from lab.cli.commands import Action
from lab.cli.log_argument import add_log_argument, chosen_log

TEXT = """Sum up a recorded run again from its log: write summary.json and contact_sheet.png (and,
with --video, video.mp4) into its directory and print the report. Beside a log of another name, such
as saved.mcap, they are called saved-summary.json and so on. Works on logs cut off by a crash."""
EXAMPLES = """examples:
  trill report runs/20260131-120000
  trill report runs/20260131-120000 --video
  trill report saved.mcap
"""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the options of ``trill report``."""
    add_log_argument(parser)
    parser.add_argument("--video", action="store_true", help="render video.mp4 too")


def run(arguments: argparse.Namespace) -> int:
    """Write summary and pictures and print the report; returns 0.

    Raises:
        LoggerError: the log cannot be read.
    """
    from lab.review.report import finish, known_verdict

    log = chosen_log(arguments.log, tell=False)
    verdict, settings = known_verdict(log)
    finish(log, verdict, settings, pictures=True, video=arguments.video)
    return 0


ACTION = Action(TEXT, EXAMPLES, add_arguments, run)
