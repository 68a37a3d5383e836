"""``trill``: the command line of the whole system."""

import argparse
from collections.abc import Sequence
from importlib.metadata import version
from platform import python_version

from common.program import run_program
from lab.cli.commands import Command, add_commands, run_chosen

EPILOG = """Each command explains itself: trill demo --help. A run leaves its files in
runs/<date-time>/: log.mcap (every message), summary.json, contact_sheet.png, video.mp4 and the
services' own output in logs/."""

COMMANDS = (
    Command("demo", "run a script or a task and report", "lab.cli.system:DEMO_ACTION"),
    Command("drive", "control the robot with your keys", "lab.cli.system:DRIVE_ACTION"),
    Command("up", "start the robot without an operator", "lab.cli.system:UP_ACTION"),
    Command("teleop", "operate the robot by browser or headset", "lab.cli.teleop:ACTION"),
    Command("top", "show the live table of a running system", "lab.cli.top:ACTION"),
    Command("stop", "stop the robot: motors limp at once", "lab.cli.plant:STOP_ACTION"),
    Command("resume", "end an emergency stop", "lab.cli.plant:RESUME_ACTION"),
    Command("reset", "stand the simulated robot up again", "lab.cli.plant:RESET_ACTION"),
    Command("record", "record a running system", "lab.cli.logs:RECORD_ACTION"),
    Command("info", "show what a log contains", "lab.cli.logs:INFO_ACTION"),
    Command("repair", "repair a broken log", "lab.cli.logs:REPAIR_ACTION"),
    Command("mark", "mark the start or end of an episode", "lab.cli.logs:MARK_ACTION"),
    Command("ledger", "show the latency breakdown of every input", "lab.cli.ledger:ACTION"),
    Command("latency", "inject latency, jitter and loss", "lab.cli.latency:ACTION"),
    Command("tasks", "describe the scored tasks", "lab.cli.tasks:ACTION"),
    Command("collect", "collect demonstrations of a task", "lab.cli.collect:ACTION"),
    Command("train", "train a policy on demonstrations", "lab.cli.train:ACTION"),
    Command("export-policy", "export a policy to ONNX", "lab.cli.export_policy:ACTION"),
    Command("dataset", "add recorded runs, export to lerobot …", "lab.cli.dataset:ACTION"),
    Command("eval", "evaluate a policy in a scored task", "lab.cli.eval:ACTION"),
    Command("study", "study latency, and compare policies", "lab.cli.study:ACTION"),
    Command("report", "sum up a recorded run again", "lab.cli.report:ACTION"),
    Command("replay", "run a log's services again, or publish the log", "lab.cli.replay:ACTION"),
    Command("export", "convert a log for viewers", "lab.cli.export:EXPORT_ACTION"),
    Command("view", "open a log in Rerun", "lab.cli.export:VIEW_ACTION"),
)


class _Version(argparse.Action):
    """Prints versions only when asked: loading the kernels takes a moment."""

    def __init__(self, option_strings: Sequence[str], dest: str, help: str) -> None:
        super().__init__(option_strings, dest, nargs=0, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object, **__: object) -> None:
        from common import native

        print(f"trill {version('trill')}, Python {python_version()}, {native.summary()}")
        parser.exit()


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command.

    Returns:
        exit code; see :func:`common.program.run_program`.
    """
    parser = argparse.ArgumentParser(
        prog="trill",
        description="Teleoperate, record and watch a humanoid made of independent services.",
        epilog=EPILOG,
    )
    parser.add_argument("--version", action=_Version, help="print versions, and exit")
    add_commands(parser, COMMANDS, "command", "command")
    return run_program("trill", lambda: run_chosen(parser.parse_args(argv), "command"))
