"""Kill operators and the controller of a walking robot; watch who has it, and whether it falls."""

import os
import random
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

from common.schemas import AuthorityState, PlantStatus, Setpoint
from common.topics import PLANT_STATUS, WBC_AUTHORITY, WBC_TARGET
from common.transport.config import BusConfig
from deploy.ports import reserve_base_port
from deploy.supervisor import SPARE_AFTER_S, Supervisor
from deploy.system import SystemOptions, environment, robot_processes
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support import stand_in
from verification.faults.support.process import Monitor, Process

NOBODY = ""
PERSON, POLICY = (stand_in.ROLES[role].name for role in ("person", "policy"))
START_S = 60.0
"""The policy must have the robot within this time from the start [s]."""
SETTLED_S = 1.5
"""Who has the robot is watched for this long after each fault [s]."""
PATIENCE_S = 15.0
"""A change that takes longer never comes [s]."""
SPARE_S = SPARE_AFTER_S + 7.0
"""After a start of the controller its successor waits, packages imported, within this time [s]."""


@dataclass
class Robot:
    """Plant and controller under a supervisor, two operators, and what is seen of them.

    Attributes:
        holder: who has the robot; None: not heard yet.
        boot: run of the controller that said so.
        changed: when that was first heard [s, monotonic].
        falls: times the robot has fallen.
        fastest: largest speed of a hand's target under one controller [m/s].
    """

    supervisor: Supervisor
    monitor: Monitor
    start: Callable[[str], Process]
    operators: dict[str, Process] = field(default_factory=dict)
    holder: str | None = None
    boot: int = 0
    changed: float = 0.0
    falls: int = 0
    fastest: float = 0.0
    restarted: float = field(default_factory=time.monotonic)
    """When the controller was last started [s, monotonic]."""
    _fallen: bool = False
    _target: Setpoint | None = None

    def watch(self, until: Callable[[], bool], longest: float) -> bool:
        """Listen until a condition holds; False if it does not within ``longest`` [s]."""
        end = time.monotonic() + longest
        while not (met := until()) and time.monotonic() < end:
            self.supervisor.poll()
            for message in self.monitor.messages():
                self._take(message)
            time.sleep(0.01)
        return met

    def wait(self, seconds: float) -> None:
        """Listen for a while [s]."""
        self.watch(lambda: False, seconds)

    def _take(self, message: object) -> None:
        match message:
            case PlantStatus():
                self.falls += message.fallen and not self._fallen
                self._fallen = message.fallen
            case AuthorityState():
                now = (message.holder, message.header.boot)
                if now != (self.holder, self.boot):
                    self.changed = time.monotonic()
                self.holder, self.boot = now
            case Setpoint():
                self._measure(message)

    def _measure(self, target: Setpoint) -> None:
        last, self._target = self._target, target
        if last is None or last.header.boot != target.header.boot:
            return
        elapsed = 1e-9 * (target.header.stamp - last.header.stamp)
        for side in ("left", "right"):
            name = f"{side}_hand_position_in_body"
            moved = float(np.linalg.norm(getattr(target, name) - getattr(last, name)))
            self.fastest = max(self.fastest, moved / elapsed)


@dataclass(frozen=True)
class Fault:
    """What is done to an operator or the controller, and who has the robot then."""

    text: str
    act: Callable[[Robot], None]
    holder: str
    restart: bool = False
    """Whether the controller is killed, so that another run of it has to say so."""


def _kill(name: str) -> Callable[[Robot], None]:
    return lambda robot: robot.operators[name].kill()


def _signal(name: str, number: int) -> Callable[[Robot], None]:
    return lambda robot: robot.operators[name].send_signal(number)


def _restart_person(robot: Robot) -> None:
    """Start the person's operator again and have it ask for the robot, until it is heard."""
    robot.operators[PERSON] = robot.start("person")
    robot.operators[PERSON].expect(stand_in.READY)
    robot.operators[PERSON].send_signal(stand_in.TAKE)


def _restart_policy(robot: Robot) -> None:
    robot.operators[POLICY] = robot.start("policy")


def _kill_controller(robot: Robot) -> None:
    os.kill(robot.supervisor.pid("wbc"), signal.SIGKILL)


FAULTS = (
    Fault("person takes the robot", _signal(PERSON, stand_in.TAKE), PERSON),
    Fault("controller killed under the person", _kill_controller, PERSON, restart=True),
    Fault("person killed", _kill(PERSON), NOBODY),
    Fault("person back, takes the robot", _restart_person, PERSON),
    Fault("person gives the robot back", _signal(PERSON, stand_in.GIVE_BACK), POLICY),
    Fault("controller killed under the policy", _kill_controller, POLICY, restart=True),
    Fault("policy killed", _kill(POLICY), NOBODY),
    Fault("policy back", _restart_policy, POLICY),
)


class Operators(FaultPlan):
    """Inject each fault in turn, round after round."""

    name = "operators"
    setup = "a walking robot; a policy that waits for it and a person, as processes"
    fault = "operators take and give back the robot; they and the controller are killed (SIGKILL)"
    recovery = "the right operator has the robot, it goes on walking, and nothing jumps"
    promises = (
        Promise("the robot never falls", "falls", 0),
        Promise("the right operator has the robot, and keeps it", "wrong", 0),
        Promise("a person has the robot at once", "max [s]", 0.5, {"fault": FAULTS[0].text}),
        Promise("the targets of the hands do not jump", "fastest target [m/s]", 1.0),
    )
    quick: ClassVar = {"rounds": 1}

    rounds: int = Field(default=5, ge=1, description="times each fault")
    faults: int = Field(
        default=len(FAULTS), ge=1, le=len(FAULTS), description="only the first of the faults"
    )
    seed: int = Field(default=0, description="seed of the random moments")

    def measure(self, progress: Progress) -> Iterator[Row]:
        """Yield a row for each fault; see the base class."""
        rng = random.Random(self.seed)
        faults = FAULTS[: self.faults]
        seen: dict[str, list[Row]] = {fault.text: [] for fault in faults}
        with _robot() as robot:
            if not robot.watch(lambda: robot.holder == POLICY, START_S):
                raise FaultError("the policy did not get the robot from the controller")
            for turn in range(self.rounds):
                for fault in faults:
                    progress(f"{fault.text}, {turn + 1} of {self.rounds}")
                    robot.wait(rng.uniform(2.0, 4.5))
                    seen[fault.text].append(_inject(fault, robot))
        for text, rows in seen.items():
            after = [float(row["after [s]"]) for row in rows]
            yield {
                "fault": text,
                "times": len(rows),
                "p50 [s]": float(np.median(after)),
                "max [s]": max(after),
                "wrong": sum(int(row["wrong"]) for row in rows),
                "falls": sum(int(row["falls"]) for row in rows),
                "gaits ended": sum(int(row["gaits ended"]) for row in rows),
                "fastest target [m/s]": max(float(row["fastest"]) for row in rows),
            }


def _inject(fault: Fault, robot: Robot) -> Row:
    """Do one thing to the robot's operators or controller and watch what follows."""
    if fault.restart:
        robot.wait(robot.restarted + SPARE_S - time.monotonic())
    falls, robot.fastest, boot = robot.falls, 0.0, robot.boot
    for operator in robot.operators.values():
        operator.count("")
    began = time.monotonic()
    fault.act(robot)
    if fault.restart:
        robot.restarted = began

    def settled() -> bool:
        return robot.holder == fault.holder and (robot.boot != boot) == fault.restart

    came = robot.watch(settled, PATIENCE_S)
    after = robot.changed - began if came else float("inf")
    left = robot.watch(lambda: not settled(), SETTLED_S)
    return {
        "after [s]": after,
        "wrong": int(not came or left),
        "falls": robot.falls - falls,
        "gaits ended": sum(o.count(stand_in.ENDED) for o in robot.operators.values()),
        "fastest": robot.fastest,
    }


@contextmanager
def _robot() -> Iterator[Robot]:
    """Run plant, controller, a policy and a person."""
    with tempfile.TemporaryDirectory() as name, reserve_base_port() as port, ExitStack() as stack:
        folder, options = Path(name), SystemOptions(cameras=False, record=False, restart=True)
        specs = [replace(s, max_restarts=1000) for s in robot_processes(options, folder)]
        bus = BusConfig(base_port=port)
        supervisor = stack.enter_context(Supervisor(specs, folder, environment(bus, None)))
        schemas = {topic.name: topic.schema for topic in (PLANT_STATUS, WBC_AUTHORITY, WBC_TARGET)}
        monitor = stack.enter_context(Monitor(port, schemas))

        def start(role: str) -> Process:
            process = Process(stand_in.MODULE, "--role", role, "--base-port", str(port))
            return stack.enter_context(process)

        robot = Robot(supervisor, monitor, start)
        robot.operators = {PERSON: start("person"), POLICY: start("policy")}
        yield robot
