"""A running system as a context: run directory, ports, processes; gone when it is left."""

import contextlib
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from common.transport.config import BusConfig, bus_of
from deploy.ports import reserve_base_port
from deploy.process import ProcessSpec, terminated_as_interrupted
from deploy.supervisor import Supervisor
from deploy.system import SystemOptions, environment, new_run_dir, robot_processes

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
"""How a run ended; unknown where only the log is left to tell."""


@dataclass(frozen=True)
class Verdict:
    """Why a run ended."""

    outcome: Outcome
    reason: str = ""


@dataclass(frozen=True)
class Ended:
    """A finished run: where its files are and how it ended."""

    run_dir: Path
    verdict: Verdict


@dataclass(frozen=True)
class Running:
    """A running system.

    Attributes:
        supervisor: its processes.
        bus: how to reach its bus.
        run_dir: where it leaves its files.
    """

    supervisor: Supervisor
    bus: BusConfig
    run_dir: Path

    @property
    def title(self) -> str:
        """What and where, for the head of a table."""
        return f"{self.run_dir}  base port {self.bus.base_port}"


@contextlib.contextmanager
def running_system(
    options: SystemOptions, base_port: int | None, operators: Sequence[ProcessSpec] = ()
) -> Iterator[Running]:
    """Start the robot's side and ``operators``; leaving the context, by whatever way, ends all.

    Ctrl-C (and SIGTERM, SIGHUP) inside the context leaves it quietly: execution goes on after it.

    Raises:
        DeployError: the system cannot be started.
        ConfigError: the bus configuration is wrong.
    """
    known = bus_of(base_port, options.config)
    with reserve_base_port(known.host, base_port) as port:
        # Not before, so that a wrong option leaves no empty directory.
        run_dir = new_run_dir()
        supervisor = Supervisor(
            [*robot_processes(options, run_dir), *operators],
            run_dir / "logs",
            environment(port, options.config, options.links),
        )
        bus = known.model_copy(update={"base_port": port})
        with contextlib.suppress(KeyboardInterrupt), terminated_as_interrupted(), supervisor:
            yield Running(supervisor, bus, run_dir)
