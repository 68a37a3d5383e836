"""Run a system inside a context: its run directory, ports and processes."""

import contextlib
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

from common.errors import ConfigError
from common.program import signals_as_keyboard_interrupt
from common.topics import HEALTH
from common.transport.config import BusConfig, bus_of
from common.transport.schema_query import discover
from common.transport.session import BusError, open_session
from deploy.errors import DeployError
from deploy.ports import PortsTakenError, reserve_base_port
from deploy.process import ProcessSpec
from deploy.supervisor import Supervisor
from deploy.system import (
    SystemOptions,
    check_torque_limits,
    environment,
    new_run_dir,
    robot_processes,
)

_LOOK_S = 0.7
"""Time to find the services that use wanted ports, and for their answers [s]."""

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
    wanted = known.base_port if "base_port" in known.model_fields_set else None
    own, ignored = own_bus(known)
    with contextlib.ExitStack() as stack:
        try:
            port = stack.enter_context(reserve_base_port(known.host, wanted))
        except PortsTakenError as error:
            raise DeployError(f"{error}{_already_there(own)}") from error
        if ignored:
            print(ignored, file=sys.stderr)
        # Made last, so that a wrong option leaves no empty directory.
        run_dir = new_run_dir()
        bus = own.model_copy(update={"base_port": port})
        supervisor = Supervisor(
            [*robot_processes(options, run_dir), *operators],
            run_dir / "logs",
            environment(bus, options.config, options.links),
        )
        with contextlib.suppress(KeyboardInterrupt), signals_as_keyboard_interrupt(), supervisor:
            yield RunningSystem(supervisor, bus, run_dir)


def own_bus(known: BusConfig) -> tuple[BusConfig, str]:
    """Return the bus of a system that is started here, and in words what of ``known`` is ignored.

    Its services are peers at the ports of the table and nothing else: whatever a shell or a file
    says about joining a bus is meant for another system, which may be running.

    Raises:
        ConfigError: the raw transport settings would join another bus.
    """
    joining = sorted({"mode", "listen", "connect"} & known.zenoh.keys())
    if joining:
        raise ConfigError(
            f"[bus.zenoh] {joining[0]}: a system that is started here must not join another one; "
            "expected neither mode, listen nor connect there"
        )
    own = known.model_copy(update={"mode": "peer", "listen": None, "connect": None})
    given = [
        name for name in ("mode", "listen", "connect") if getattr(known, name) != getattr(own, name)
    ]
    if not given:
        return own, ""
    names = ", ".join(f"TRILL_{name.upper()} or [bus] {name}" for name in given)
    return own, (
        f"not used: {names}; a system that is started here has a bus of its own (to join a running "
        "one, start an operator, a logger or `trill top`)"
    )


def _already_there(bus: BusConfig) -> str:
    """Say which robots' services run at the ports of ``bus``; empty if none answers."""
    looking = bus.model_copy(update={"listen": ()})
    try:
        session: Any = open_session(looking, "launcher")
    except BusError:
        return ""
    try:
        time.sleep(_LOOK_S)
        found = discover(session, timeout=_LOOK_S)
    finally:
        session.close()
    return "".join(
        f"; {robot} is running there: {', '.join(sorted(_services(keys)))}"
        for robot, keys in sorted(found.items())
    )


def _services(keys: Iterable[str]) -> set[str]:
    """Return the services that publish ``keys``, by their health."""
    return {
        service
        for key in keys
        for topic, _, service in [key.partition("/")[2].partition("/")]
        if topic == HEALTH.name
    }
