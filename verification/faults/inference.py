"""Stop, kill and double the inference server of a walking robot; watch it hold and go on."""

import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import ClassVar

import numpy as np
from pydantic import Field

from common.packages import require
from common.schemas import PlantStatus, PolicyMode, PolicyState, Setpoint
from common.topics import PLANT_STATUS, POLICY_STATE, TELEOP_SETPOINT
from common.transport.config import BusConfig
from deploy.ports import reserve_base_port
from deploy.supervisor import Supervisor
from deploy.system import SystemOptions, environment, policy_process, robot_processes
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support.process import Monitor, Process

START_S = 90.0
"""The policy must be acting within this time from the start [s]."""
PATIENCE_S = 60.0
"""What takes longer never comes [s]."""
SILENT_S = 4.0
"""For so long there is no server [s]; a plan takes 1 s, giving a request up another one."""
SERVER = "services.policy.server"


@dataclass
class Robot:
    """Plant, controller and policy under a supervisor, inference servers, and what is seen.

    Attributes:
        mode: of the policy.
        answers: that the policy has had.
        gaits: that it has requested.
        held: positions (3,) of the left hand's set-points while no server is there [m].
        falls: times the robot has fallen.
    """

    supervisor: Supervisor
    monitor: Monitor
    start: Callable[[], Process]
    servers: list[Process] = field(default_factory=list)
    mode: PolicyMode = PolicyMode.WAITING
    answers: int = 0
    gaits: int = 0
    held: list[tuple[float, ...]] = field(default_factory=list)
    falls: int = 0
    _fallen: bool = False

    def watch(self, until: Callable[[], bool], longest: float) -> float:
        """Listen until a condition holds; return the time it took, infinite if too long [s]."""
        began = time.monotonic()
        while (passed := time.monotonic() - began) < longest:
            self.supervisor.poll()
            for message in self.monitor.messages():
                self._take(message)
            if until():
                return passed
            time.sleep(0.01)
        return float("inf")

    def _take(self, message: object) -> None:
        match message:
            case PlantStatus():
                self.falls += message.fallen and not self._fallen
                self._fallen = message.fallen
            case PolicyState():
                self.mode, self.answers = message.mode, message.answers
                self.gaits = message.gaits
            case Setpoint() if self.mode in {PolicyMode.RECONNECTING, PolicyMode.STARVED}:
                self.held.append(tuple(message.left_hand_position_in_body.tolist()))


def _stop(robot: Robot) -> None:
    robot.servers[0].send_signal(signal.SIGSTOP)


def _continue(robot: Robot) -> None:
    robot.servers[0].send_signal(signal.SIGCONT)


def _kill(robot: Robot) -> None:
    robot.servers.pop(0).kill()


def _start(robot: Robot) -> None:
    robot.servers.append(robot.start())


FAULTS: dict[str, tuple[Callable[[Robot], None], Callable[[Robot], None]]] = {
    "stopped (SIGSTOP), continued": (_stop, _continue),
    "killed, another one started": (_kill, _start),
}
"""What ends the service of the only server, and what brings it back."""
DOUBLED = "one of two killed"


class Inference(FaultPlan):
    """Take the server away in turn, round after round; at last one of two."""

    name = "inference"
    setup = "a walking robot; a policy of random weights; its inference server, as processes"
    fault = "the server is stopped, killed and started again; one of two is killed"
    recovery = "the hands hold, the robot stays up, and the policy goes on by itself"
    promises = (
        Promise("the robot never falls", "falls", 0),
        Promise("without a server the hands' set-points rest", "moved [mm]", 0.0),
        Promise("a server that is back is used at once", "back max [s]", 1.5,
                {"server": "stopped (SIGSTOP), continued"}),
        Promise("a policy with another server does not hold", "held", 0, {"server": DOUBLED}),
    )  # fmt: skip
    quick: ClassVar = {"rounds": 1}

    rounds: int = Field(default=5, ge=1, description="times each fault")

    def measure(self, progress: Progress) -> Iterator[Row]:
        """Yield a row for each fault; see the base class."""
        require("verification.faults inference", "policy", "torch", "safetensors")
        with _robot() as robot:
            _start(robot)
            _await(robot, "the policy does not act", START_S)
            for text, (end, begin) in FAULTS.items():
                rows = []
                for turn in range(self.rounds):
                    progress(f"server {text}, {turn + 1} of {self.rounds}")
                    rows.append(_without(robot, end, begin))
                yield _summed(text, rows)
            progress(DOUBLED)
            yield _summed(DOUBLED, [_doubled(robot)])


def _without(robot: Robot, end: Callable[[Robot], None], begin: Callable[[Robot], None]) -> Row:
    """Take the only server away and bring it back."""
    robot.watch(lambda: False, 2.0)
    robot.held.clear()
    falls, gaits = robot.falls, robot.gaits
    end(robot)
    holding = robot.watch(
        lambda: robot.mode in {PolicyMode.STARVED, PolicyMode.RECONNECTING}, PATIENCE_S
    )
    robot.watch(lambda: False, max(0.0, SILENT_S - holding))
    held, answers = list(robot.held), robot.answers
    begin(robot)
    back = robot.watch(lambda: robot.answers > answers and robot.mode is PolicyMode.OK, PATIENCE_S)
    moved = float(np.ptp(np.array(held), axis=0).max()) if held else float("nan")
    return {
        "held": 1,
        "holding": holding,
        "back": back,
        "moved": 1e3 * moved,
        "gaits": robot.gaits - gaits,
        "falls": robot.falls - falls,
    }


def _doubled(robot: Robot) -> Row:
    """Kill one of two servers."""
    _start(robot)
    # Both answer once the second answer to a request is dropped; its start takes seconds.
    robot.watch(lambda: False, 15.0)
    robot.held.clear()
    falls, answers, gaits = robot.falls, robot.answers, robot.gaits
    _kill(robot)
    robot.watch(lambda: False, SILENT_S)
    if robot.answers == answers:
        raise FaultError("the second server did not answer")
    return {
        "held": int(bool(robot.held)),
        "holding": 0.0,
        "back": 0.0,
        "moved": 0.0,
        "gaits": robot.gaits - gaits,
        "falls": robot.falls - falls,
    }


def _summed(text: str, rows: list[Row]) -> Row:
    def of(name: str) -> list[float]:
        return [float(row[name]) for row in rows]

    return {
        "server": text,
        "times": len(rows),
        "held": int(sum(of("held"))),
        "holding p50 [s]": float(np.median(of("holding"))),
        "back p50 [s]": float(np.median(of("back"))),
        "back max [s]": max(of("back")),
        "moved [mm]": max(of("moved")),
        "gaits": int(sum(of("gaits"))),
        "falls": int(sum(of("falls"))),
    }


def _await(robot: Robot, otherwise: str, longest: float) -> None:
    if robot.watch(lambda: robot.mode is PolicyMode.OK, longest) == float("inf"):
        raise FaultError(f"{otherwise} within {longest:g} s")


@contextmanager
def _robot() -> Iterator[Robot]:
    """Run plant, controller and a policy that asks a server."""
    from verification.faults.support.policy import random_policy

    with tempfile.TemporaryDirectory() as name, reserve_base_port() as port, ExitStack() as stack:
        folder, options = Path(name), SystemOptions(cameras=False, record=False, restart=True)
        checkpoint = random_policy(folder / "policy")
        specs = [replace(s, max_restarts=1000) for s in robot_processes(options, folder)]
        specs.append(policy_process(checkpoint, "--remote"))
        bus = BusConfig(base_port=port)
        supervisor = stack.enter_context(Supervisor(specs, folder, environment(bus, None)))
        schemas = {t.name: t.schema for t in (PLANT_STATUS, POLICY_STATE, TELEOP_SETPOINT)}
        monitor = stack.enter_context(Monitor(port, schemas))

        def start() -> Process:
            process = Process(SERVER, str(checkpoint), "--base-port", str(port))
            return stack.enter_context(process)

        yield Robot(supervisor, monitor, start)
