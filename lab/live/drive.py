"""Run the whole system under a person's keys, or the robot's side alone."""

import time
from collections.abc import Sequence

from deploy.launch import RunResult, Verdict, running_system
from deploy.process import ProcessSpec
from deploy.system import SystemOptions, operator_process, terminal
from lab.errors import LabError
from lab.live.loop import essential_exit, show_until_verdict
from lab.live.new_trials import TrialStarter
from lab.monitor.monitor import POLL_PERIOD, monitored


def run_drive(options: SystemOptions, base_port: int | None = None) -> RunResult:
    """Run the robot with the keyboard operator in this terminal until the person leaves.

    Raises:
        LabError: there is no terminal.
        DeployError: the system cannot be started.
    """
    if not terminal():
        raise LabError(
            "drive needs a terminal for your keys; start it in one (ssh -t, not a pipe), or run "
            "`trill demo`, which needs none"
        )
    verdict = Verdict("completed", "left by Ctrl-C")
    keyboard = operator_process("keyboard", foreground=True)
    with running_system(options, base_port, [keyboard]) as running:
        while True:
            if over := essential_exit(running.supervisor.poll()):
                verdict = over
                break
            time.sleep(POLL_PERIOD)
    return RunResult(running.run_dir, verdict)


def run_up(
    options: SystemOptions, base_port: int | None = None, operators: Sequence[ProcessSpec] = ()
) -> RunResult:
    """Run the robot's side and ``operators`` with the live table until Ctrl-C.

    Other operators come and go by themselves. With a task, a new operator begins a new trial.

    Raises:
        DeployError: the system cannot be started.
        BusError: the live table cannot reach the bus.
    """
    verdict = Verdict("completed", "stopped by Ctrl-C")
    with (
        running_system(options, base_port, operators) as running,
        monitored(running.bus) as monitor,
    ):
        starter = TrialStarter(monitor.session, running.bus.robot)
        verdict = show_until_verdict(
            running,
            monitor,
            "trill up",
            lambda _elapsed, _view, exits: essential_exit(exits),
            on_snapshot=starter.update,
        )
    return RunResult(running.run_dir, verdict)
