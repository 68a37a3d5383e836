"""The whole system under an operator of its own, watched until script or task is over."""

import time
from collections.abc import Sequence
from dataclasses import dataclass, field

from deploy.launch import Ended, Running, Verdict, running_system
from deploy.process import Exit
from deploy.system import OPERATOR, SystemOptions, scripted_operator, synthetic_operator
from lab.live.task_judge import TaskJudge
from lab.monitor.bus_stats import Snapshot
from lab.monitor.monitor import TICK, Screen, Watch
from services.teleop.scripted.library import ScriptOptions, script_named

DEMONSTRATION = "demo"
"""The script that shows everything."""
FALL_AFTERMATH = 1.0
"""How long a fall is watched before everything stops [s]."""


@dataclass(frozen=True)
class DemoOptions:
    """How to run the demonstration.

    Attributes:
        system: the robot's side.
        script: what the operator plays: a built-in name or a JSON file; None: the task, if the
            system has one (by the synthetic operator), else the demonstration.
        seconds: end this long after the controller was first heard, wherever the script is, and
            well; a task without a verdict by then has timed out. None: to the end.
        timeout: the script has failed if it is not done by then [s].
        base_port: take this block of ports instead of a free one.
        live: force (or forbid) the live table; None decides by the terminal.
    """

    system: SystemOptions = field(default_factory=SystemOptions)
    script: str | None = None
    seconds: float | None = None
    timeout: float = 600.0
    base_port: int | None = None
    live: bool | None = None


class Judge:
    """Decides, look by look, whether a run is over and why. Pure."""

    def __init__(self, operator: str, seconds: float | None, timeout: float) -> None:
        """Judge a run whose operator is the process ``operator``."""
        self._operator = operator
        self._seconds = seconds
        self._timeout = timeout
        self._fell_at: float | None = None
        self._began_at: float | None = None

    def verdict(
        self, elapsed: float, view: Snapshot, exits: Sequence[tuple[Exit, bool]]
    ) -> Verdict | None:
        """The verdict, or None while the run goes on.

        Args:
            elapsed: since the start [s].
            view: the bus as last seen.
            exits: processes that just ended, each with whether it was essential.
        """
        if self._began_at is None and view.control is not None:
            self._began_at = elapsed
        if self._fell_at is None and view.plant is not None and view.plant.fallen:
            self._fell_at = elapsed
        if self._fell_at is not None:
            # A script that fails because the robot fell is not the reason but the consequence.
            over = elapsed >= self._fell_at + FALL_AFTERMATH
            return Verdict("fell", self._where(view)) if over else None
        for ended, essential in exits:
            if ended.restarted or not essential:
                continue
            if ended.name == self._operator:
                return self._operator_ended(ended, view)
            return Verdict("service died", ended.describe())
        if self._seconds is not None and self._lasted(elapsed) >= self._seconds:
            return Verdict("completed", f"stopped after {self._seconds:g} s, as asked")
        if elapsed >= self._timeout:
            return Verdict("timed out", f"not done after {self._timeout:g} s; {self._where(view)}")
        return None

    def _lasted(self, elapsed: float) -> float:
        """Since the controller was first heard [s]."""
        return 0.0 if self._began_at is None else elapsed - self._began_at

    @staticmethod
    def _operator_ended(ended: Exit, view: Snapshot) -> Verdict:
        if ended.expected:
            return Verdict("completed")
        failed = view.operator.failed if view.operator is not None else ""
        return Verdict("script failed", failed or ended.describe())

    @staticmethod
    def _where(view: Snapshot) -> str:
        if view.operator is None:
            return "the operator was not heard"
        at = view.operator
        return f"at step {at.step} of {at.steps} of the script: {at.label or 'its beginning'}"


def run_demo(options: DemoOptions) -> Ended:
    """Start everything, watch until the verdict, stop everything.

    Raises:
        ConfigError: there is no such script, or the bus configuration is wrong.
        DeployError: the system cannot be started.
        BusError: the live table cannot reach the bus.
    """
    task, judge = options.system.task, _judge(options)
    if isinstance(judge, TaskJudge) and task is not None:
        operator = synthetic_operator(task, options.system.seed)
    else:
        script = options.script or DEMONSTRATION
        script_named(script, ScriptOptions())
        operator = scripted_operator(script)
    verdict = Verdict("interrupted", "stopped from outside")
    with running_system(options.system, options.base_port, [operator]) as running:
        verdict = _watch(running, judge, live=options.live)
    return Ended(running.run_dir, verdict)


def _judge(options: DemoOptions) -> Judge | TaskJudge:
    by_task = options.system.task is not None and options.script is None
    kind = TaskJudge if by_task else Judge
    return kind(OPERATOR, options.seconds, options.timeout)


def _watch(running: Running, judge: Judge | TaskJudge, *, live: bool | None) -> Verdict:
    """Show the live table until there is a verdict."""
    supervisor = running.supervisor
    started = time.monotonic()
    with Watch(running.bus) as seen, Screen(f"trill demo  {running.title}", live=live) as s:
        s.say(f"{running.title}: running {', '.join(supervisor.running())}")
        while True:
            view = seen.look()
            s.show(view)
            exits = [(ended, supervisor.spec(ended.name).essential) for ended in supervisor.poll()]
            for ended, _ in exits:
                if not ended.expected:
                    s.say(ended.describe())
            verdict = judge.verdict(time.monotonic() - started, view, exits)
            if verdict is not None:
                return verdict
            time.sleep(TICK)
