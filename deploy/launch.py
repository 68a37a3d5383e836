"""Run a system inside a context: its run directory, ports and processes."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from common.program import signals_as_keyboard_interrupt
from common.transport.config import BusConfig, bus_of
from deploy.ports import reserve_base_port
from deploy.process import ProcessSpec
from deploy.supervisor import Supervisor
from deploy.system import (
    SystemOptions,
    check_torque_limits,
    environment,
    new_run_dir,
    robot_processes,
)

Outcome = Literal[
    "completed",
    "fell",
    "script failed",
    "partial success",
    "task failed",
    "service died",
    "timed out",
    "interrupted",
    "unknown",
]
"""How a run ended; unknown if only its log is left."""


@dataclass(frozen=True)
class Verdict:
    """How and why a run ended."""

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True)
class RunResult:
    """A finished run: the directory of its files, and its verdict."""

    run_dir: Path
    verdict: Verdict


@dataclass(frozen=True)
class RunningSystem:
    """Processes of a running system, the bus to join it by, and the directory of its files."""

    supervisor: Supervisor
    bus: BusConfig
    run_dir: Path

    @property
    def title(self) -> str:
        """Run directory and base port, for the head of a table."""
        return f"{self.run_dir}  base port {self.bus.base_port}"


@contextlib.contextmanager
def running_system(
    options: SystemOptions, base_port: int | None, operators: Sequence[ProcessSpec] = ()
) -> Iterator[RunningSystem]:
    """Start the robot's side and ``operators``; leaving the context ends all of them.

    Ctrl-C, SIGTERM and SIGHUP inside the context leave it without an exception: execution goes on
    after it.

    Raises:
        DeployError: the system cannot be started.
        ConfigError: the bus configuration is wrong, or plant and controller do not fit.
    """
    check_torque_limits(options)
    known = bus_of(options.config, base_port=base_port)
    with reserve_base_port(known.host, base_port) as port:
        # Made last, so that a wrong option leaves no empty directory.
        run_dir = new_run_dir()
        supervisor = Supervisor(
            [*robot_processes(options, run_dir), *operators],
            run_dir / "logs",
            environment(port, options.config, options.links),
        )
        bus = known.model_copy(update={"base_port": port})
        with contextlib.suppress(KeyboardInterrupt), signals_as_keyboard_interrupt(), supervisor:
            yield RunningSystem(supervisor, bus, run_dir)
