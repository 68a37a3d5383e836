"""Attach, pause or kill a logger beside a walking robot and compare the controller's timing.

Plant, controller, router and a scripted operator that keeps walking run live. The conditions take
turns within one run, so that other load of the machine affects all of them alike. The controller's
own loop times and the plant's state age at the torque are compared, and falls are counted.
"""

import tempfile
import time
from collections.abc import Sequence
from contextlib import ExitStack
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
        seen: dict[str, list[list[Message]]] = {condition: [] for condition in CONDITIONS}
        with (
            tempfile.TemporaryDirectory() as folder,
            reserve_base_port() as port,
            ExitStack() as stack,
        ):
            for module, *arguments in MODULES:
                stack.enter_context(Process(module, *arguments, "--base-port", str(port)))
            monitor = stack.enter_context(Monitor(port, SCHEMAS))
            progress("waiting for the first gait")
            if not any(getattr(m, "gaits_completed", 0) for m in monitor.listen(TIMEOUT_S)):
                raise FaultError(f"the robot did not complete a gait within {TIMEOUT_S:g} s")
            turns = [condition for _ in range(self.rounds) for condition in CONDITIONS]
            for number, condition in enumerate(turns, 1):
                progress(f"{number} of {len(turns)}: logger {condition}")
                router = f"tcp/127.0.0.1:{port + ROUTER_OFFSET}"
                route = ("--mode", "client", "--connect", router)
                with ExitStack() as attached:
                    if condition != "none":
                        logger = Process("services.logger", "--out", f"{folder}/{number}", *route)
                        attached.enter_context(logger)
                    time.sleep(SETTLE_S)
                    if condition != "none":
                        logger.inject(condition)
                    seen[condition].append(list(monitor.listen(self.seconds)))
                time.sleep(SETTLE_S)
        reference = _loop_p99(seen["none"])
        return [_row(condition, rounds, reference) for condition, rounds in seen.items()]


def _loop_p99(rounds: Sequence[Sequence[Message]]) -> list[float]:
    """Return the 99th percentiles of the controller's loop, as it published them [ms]."""
    return [1e3 * m.step_p99 for part in rounds for m in part if isinstance(m, ServiceHealth)]


def _row(condition: str, rounds: Sequence[Sequence[Message]], reference: Sequence[float]) -> Row:
    """Summarise what was published during all rounds of a condition.

    Raises:
        FaultError: the controller or the plant published nothing.
    """
    health = [[m for m in part if isinstance(m, ServiceHealth)] for part in rounds]
    states = [[m for m in part if isinstance(m, ControllerState)] for part in rounds]
    status = [m for part in rounds for m in part if isinstance(m, PlantStatus)]
    if not (all(health) and all(states) and status):
        raise FaultError("the robot's services have stopped publishing")
    p99 = _loop_p99(rounds)
    return {
        "logger": condition,
        "loop p50 [ms]": float(np.median([1e3 * m.step_median for part in health for m in part])),
        "p99 [ms]": float(np.median(p99)),
        "lowest": min(p99),
        "highest": max(p99),
        "p99 ratio": float(np.median(p99) / np.median(reference)),
        "age p99 [ms]": float(np.median([1e3 * m.age_at_torque_p99 for m in status])),
        "misses": sum(part[-1].deadline_misses - part[0].deadline_misses for part in health),
        "steps": sum(part[-1].steps - part[0].steps for part in health),
        "gaits": sum(part[-1].gaits_completed - part[0].gaits_completed for part in states),
        "fell": int(any(m.fallen for m in status)),
    }
