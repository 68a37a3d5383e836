"""The whole system under a person's keys, and the robot's side alone."""

import time
from collections.abc import Sequence

from deploy.launch import Ended, Verdict, running_system
from deploy.process import Exit
from deploy.supervisor import Supervisor
from deploy.system import SystemOptions, keyboard_operator, terminal
from lab.errors import LabError
from lab.live.new_trials import TrialBeginner
from lab.monitor.monitor import TICK, Screen, Watch


def run_drive(options: SystemOptions, base_port: int | None = None) -> Ended:
    """Run the robot with the keyboard operator in this terminal until the person leaves.

    Raises:
        DeployError: there is no terminal, or the system cannot be started.
    """
    if not terminal():
        raise LabError(
            "drive needs a terminal for your keys; start it in one (ssh -t, not a pipe), or run "
            "`trill demo`, which needs none"
        )
    verdict = Verdict("completed", "left by Ctrl-C")
    with running_system(options, base_port, [keyboard_operator()]) as running:
        while True:
            last = _decisive(running.supervisor, running.supervisor.poll())
            if last is not None:
                verdict = _verdict(last)
                break
            time.sleep(TICK)
    return Ended(running.run_dir, verdict)


def run_up(options: SystemOptions, base_port: int | None = None) -> Ended:
    """Run the robot's side with the live table until Ctrl-C; operators come and go by themselves.

    With a task, an operator that comes begins a new trial.

    Raises:
        DeployError: the system cannot be started.
        BusError: the live table cannot reach the bus.
    """
    verdict = Verdict("completed", "stopped by Ctrl-C")
    with running_system(options, base_port) as running, Watch(running.bus) as seen:
        supervisor = running.supervisor
        beginner = TrialBeginner(seen.session, running.bus.robot)
        with Screen(f"trill up  {running.title}") as screen:
            screen.say(f"{running.title}: running {', '.join(supervisor.running())}")
            while True:
                view = seen.look()
                screen.show(view)
                if said := beginner.look(view):
                    screen.say(said)
                exits = supervisor.poll()
                for ended in exits:
                    screen.say(ended.describe())
                last = _decisive(supervisor, exits)
                if last is not None:
                    verdict = _verdict(last)
                    break
                time.sleep(TICK)
    return Ended(running.run_dir, verdict)


def _verdict(last: Exit) -> Verdict:
    return Verdict("completed") if last.expected else Verdict("service died", last.describe())


def _decisive(supervisor: Supervisor, exits: Sequence[Exit]) -> Exit | None:
    """The first end of a process without which there is no going on."""
    for ended in exits:
        if not ended.restarted and supervisor.spec(ended.name).essential:
            return ended
    return None
