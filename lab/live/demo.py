"""Run the whole system with an operator that is no person, until script or task is over."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from common.schemas import GuardMode
from deploy.launch import RunResult, Verdict, running_system
from deploy.process import Exit, ProcessSpec
from deploy.system import OPERATOR, SystemOptions, operator_process, policy_process
from lab.live.loop import show_until_verdict
from lab.live.task_judge import TaskJudge
from lab.monitor.bus_stats import Snapshot
from lab.monitor.monitor import monitored
from lab.monitor.status_text import format_stop
from services.teleop.scripted.library import ScriptOptions, script_named

DEMONSTRATION = "demo"
"""Name of the script that shows everything."""
FALL_AFTERMATH = 1.0
"""Time for which a fall is shown before everything is stopped [s]."""


@dataclass(frozen=True)
class DemoOptions:
    """Options of the demonstration.

    Attributes:
        system: options of the robot's side.
        script: built-in name or JSON file of the operator's script; None for the synthetic
            operator if the system has a task, and for :data:`DEMONSTRATION` if not.
        policy: checkpoint that does the system's task in place of the synthetic operator.
        inference: options of ``python -m services.policy``: where and by what it is computed.
        seconds: end after this time from the controller's first message [s]: a script counts as
            completed then, a task as timed out. None: go on to the end.
        timeout: give up after this time from the start [s].
        base_port: first port; None finds a free block of ports.
        live: force (or forbid) the live table; None decides by the terminal.
    """

    system: SystemOptions = field(default_factory=SystemOptions)
    script: str | None = None
    policy: Path | None = None
    inference: tuple[str, ...] = ()
    seconds: float | None = None
    timeout: float = 600.0
    base_port: int | None = None
    live: bool | None = None


class ScriptJudge:
    """Decides when the run of a script is over and why. Pure."""

    def __init__(self, operator: str, seconds: float | None, timeout: float) -> None:
        """Judge a run whose operator is the process ``operator``; see :class:`DemoOptions`."""
        self._operator = operator
        self._seconds = seconds
        self._timeout = timeout
        self._fell_at: float | None = None
        self._began_at: float | None = None

    def verdict(self, elapsed: float, view: Snapshot, exits: Sequence[Exit]) -> Verdict | None:
        """Return the verdict, or None while the run goes on; ``elapsed`` since the start [s]."""
        if self._began_at is None and view.control is not None:
            self._began_at = elapsed
        if self._fell_at is None and view.plant is not None and view.plant.fallen:
            self._fell_at = elapsed
        if self._fell_at is not None:
            # A script that fails now does so because the robot fell.
            over = elapsed >= self._fell_at + FALL_AFTERMATH
            return Verdict("fell", self._stop(view) + self._step(view)) if over else None
        for ended in exits:
            if ended.restarted or not ended.essential:
                continue
            if ended.name == self._operator:
                return self._operator_ended(ended, view)
            return Verdict("service died", ended.describe())
        if self._seconds is not None and self._lasted(elapsed) >= self._seconds:
            return Verdict("completed", f"stopped after {self._seconds:g} s, as asked")
        if elapsed >= self._timeout:
            return Verdict("timed out", f"not done after {self._timeout:g} s; {self._step(view)}")
        return None

    def _lasted(self, elapsed: float) -> float:
        """Return the time since the controller's first message [s]."""
        return 0.0 if self._began_at is None else elapsed - self._began_at

    @staticmethod
    def _operator_ended(ended: Exit, view: Snapshot) -> Verdict:
        if ended.expected:
            return Verdict("completed")
        failed = view.operator.failed if view.operator is not None else ""
        return Verdict("script failed", failed or ended.describe())

    @staticmethod
    def _stop(view: Snapshot) -> str:
        """Say that the robot fell because it was stopped; empty if it was not."""
        if view.plant is None or view.plant.guard is not GuardMode.ESTOP:
            return ""
        return f"{format_stop(view.plant)}, "

    @staticmethod
    def _step(view: Snapshot) -> str:
        if view.operator is None:
            return "no message from the operator"
        status = view.operator
        label = status.label or "its beginning"
        return f"at step {status.step} of {status.steps} of the script: {label}"


def run_demo(options: DemoOptions) -> RunResult:
    """Start the whole system, show it until the verdict and stop it.

    Raises:
        ConfigError: there is no such script, or the bus configuration is wrong.
        DeployError: the system cannot be started.
        BusError: the live table cannot reach the bus.
    """
    operator, judge = _operator_and_judge(options)
    verdict = Verdict("interrupted", "stopped by Ctrl-C or a signal")
    with (
        running_system(options.system, options.base_port, [operator]) as running,
        monitored(running.bus) as monitor,
    ):
        verdict = show_until_verdict(
            running, monitor, "trill demo", judge.verdict, live=options.live
        )
    return RunResult(running.run_dir, verdict)


def _operator_and_judge(options: DemoOptions) -> tuple[ProcessSpec, ScriptJudge | TaskJudge]:
    """Return the operator to start, and the judge of its run.

    Raises:
        ConfigError: there is no such script.
    """
    task, limits = options.system.task, (OPERATOR, options.seconds, options.timeout)
    if options.policy is not None:
        # A policy that fails is to be seen, not to be started again.
        policy = replace(policy_process(options.policy, *options.inference), restart=False)
        return policy, TaskJudge(policy.name, *limits[1:])
    if task is not None and options.script is None:
        seed = str(options.system.seed or 0)
        operator = operator_process("synthetic", "--task", task, "--seed", seed, "--stay")
        return operator, TaskJudge(*limits)
    script = options.script or DEMONSTRATION
    script_named(script, ScriptOptions())
    return operator_process("scripted", "--script", script), ScriptJudge(*limits)
