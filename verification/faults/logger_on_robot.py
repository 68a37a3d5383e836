"""Attach, pause or kill a logger beside a walking robot and compare the controller's timing.

Plant, controller, router and a scripted operator that keeps walking run live. The conditions take
turns within one run, so that other load of the machine affects all of them alike. The controller's
own loop times and the plant's state age at the torque are compared, and falls are counted.
"""

import signal
import tempfile
import time
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from common.ports import ROUTER_OFFSET
from common.schemas import ControllerState, Message, PlantStatus, ServiceHealth
from deploy.ports import reserve_base_port
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support.process import TIMEOUT_S, Monitor, Process

CONDITIONS = ("none", "attached", "paused", "killed")
SETTLE_S = 3.0
"""Between two conditions: the controller's health covers the last two seconds [s]."""
SCHEMAS: dict[str, type[Message]] = {
    "health/wbc": ServiceHealth,
    "plant/status": PlantStatus,
    "wbc/state": ControllerState,
}
MODULES = (
    ("services.sim",),
    ("services.wbc",),
    ("deploy.router",),
    ("services.teleop", "scripted", "--script", "random", "--count", "10000"),
)


class LoggerOnRobot(FaultPlan):
    """Let a logger be absent, attached, paused and killed in turn."""

    name = "logger_on_robot"
    setup = "plant, controller, router and a scripted operator that keeps walking, live"
    fault = "a logger is attached, paused (SIGSTOP) or killed (SIGKILL)"
    recovery = "the robot walks on with the timing that it has without a logger"
    promises = (
        Promise("the robot does not fall", "fell", 0),
        Promise("a logger does not slow the controller's loop down: p99", "p99 ratio", 2.0),
    )
    quick: ClassVar = {"rounds": 1, "seconds": 6.0}

    rounds: int = Field(default=3, ge=1, description="times each condition")
    seconds: float = Field(default=10.0, ge=2.0, description="length of each condition [s]")

    def measure(self, progress: Progress) -> list[Row]:
        """Return a row for each condition; see the base class."""
        windows = {condition: Window() for condition in CONDITIONS}
        with (
            tempfile.TemporaryDirectory() as folder,
            reserve_base_port() as port,
            ExitStack() as stack,
        ):
            environment = {"TRILL_BASE_PORT": str(port)}
            for module, *arguments in MODULES:
                stack.enter_context(Process(module, *arguments, environment=environment))
            monitor = stack.enter_context(Monitor(port, SCHEMAS))
            progress("waiting for the first gait")
            _wait_for_gait(monitor)
            for number in range(self.rounds):
                for condition, window in windows.items():
                    progress(f"round {number + 1}: logger {condition}")
                    with _logger(condition, port, Path(folder) / f"{condition}-{number}"):
                        window.record(monitor, self.seconds)
                    time.sleep(SETTLE_S)
        return [window.row(condition, windows["none"]) for condition, window in windows.items()]


@dataclass
class Window:
    """What was published during one condition, all its rounds together."""

    health: list[list[ServiceHealth]] = field(default_factory=list)
    status: list[PlantStatus] = field(default_factory=list)
    gaits: int = 0

    def record(self, monitor: Monitor, seconds: float) -> None:
        """Add what is published during the next seconds.

        Raises:
            FaultError: the controller publishes nothing.
        """
        health: list[ServiceHealth] = []
        gaits: list[int] = []
        for message in monitor.listen(seconds):
            if isinstance(message, ServiceHealth):
                health.append(message)
            elif isinstance(message, PlantStatus):
                self.status.append(message)
            else:
                gaits.append(message.gaits_completed)
        if not (health and gaits):
            raise FaultError("the controller has stopped publishing")
        self.health.append(health)
        self.gaits += gaits[-1] - gaits[0]

    @property
    def p99(self) -> list[float]:
        """99th percentiles of the controller's loop, as it published them [ms]."""
        return [1e3 * message.step_p99 for part in self.health for message in part]

    def row(self, condition: str, reference: "Window") -> Row:
        """Summarise the controller's loop, compared with ``reference``, and the state age."""
        median = [1e3 * message.step_median for part in self.health for message in part]
        age = [1e3 * message.age_at_torque_p99 for message in self.status]
        p99 = float(np.median(self.p99))
        return {
            "logger": condition,
            "loop p50 [ms]": float(np.median(median)),
            "p99 [ms]": p99,
            "lowest": min(self.p99),
            "highest": max(self.p99),
            "p99 ratio": p99 / float(np.median(reference.p99)),
            "age p99 [ms]": float(np.median(age)),
            "misses": sum(p[-1].deadline_misses - p[0].deadline_misses for p in self.health),
            "steps": sum(p[-1].steps - p[0].steps for p in self.health),
            "gaits": self.gaits,
            "fell": int(any(message.fallen for message in self.status)),
        }


def _wait_for_gait(monitor: Monitor) -> None:
    for message in monitor.listen(TIMEOUT_S):
        if isinstance(message, ControllerState) and message.gaits_completed:
            return
    raise FaultError(f"the robot did not complete a gait within {TIMEOUT_S:g} s")


@contextmanager
def _logger(condition: str, port: int, folder: Path) -> Iterator[None]:
    """Run a logger that is attached, paused or killed inside the context; or none."""
    if condition == "none":
        time.sleep(SETTLE_S)
        yield
        return
    router = f"tcp/127.0.0.1:{port + ROUTER_OFFSET}"
    route = ("--mode", "client", "--connect", router)
    with Process("services.logger", "--out", str(folder), *route) as logger:
        time.sleep(SETTLE_S)
        if condition == "paused":
            logger.send_signal(signal.SIGSTOP)
        elif condition == "killed":
            logger.kill()
        yield
        if condition == "paused":
            logger.send_signal(signal.SIGCONT)
            time.sleep(1.0)
