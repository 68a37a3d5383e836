"""A robot that stands and walks in simulated physics under the service's command."""

from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from common.runtime.service import Output
from common.schemas import (
    ControllerState,
    ControlState,
    Gait,
    GaitOutcome,
    GaitReply,
    JointCommand,
    Message,
    PlantState,
    Setpoint,
)
from common.topics import (
    PLANT_STATE,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_COMMAND,
    WBC_REPLY,
    WBC_STATE,
    Topic,
)
from services.sim.config import SimConfig
from services.sim.physics.plant import Plant
from services.wbc.config import WbcConfig
from services.wbc.qp import QpData
from services.wbc.service import WbcService
from services.wbc.solvers import Solution, Solver
from tests.services.inputs import FakeInputs

from .support import MS, claim, copy_qp, request


@dataclass(frozen=True)
class Tick:
    """One tick of the running controller.

    Attributes:
        state: what was measured.
        data, solution: the QP and what the controller's solver found.
        control: the discrete state.
        command: the answer.
    """

    state: PlantState
    data: QpData
    solution: Solution
    control: ControlState
    command: JointCommand


class RecordingSolver:
    """Passes QPs on to a solver and keeps the last with its solution."""

    def __init__(self, inner: Solver) -> None:
        self.name = inner.name
        self._inner = inner
        self.last: tuple[QpData, Solution] | None = None

    def solve(self, data: QpData) -> Solution:
        solution = self._inner.solve(data)
        self.last = copy_qp(data), solution
        return solution


@dataclass
class Bench:
    """Service and plant in one loop of robot time: 100 Hz, each command applied late.

    One operator has the robot from the first tick on, as long as it claims it.

    Attributes:
        delay_ms: from a state's measurement to the motors.
        replies, states, commands: everything the controller said so far.
        claims: whether the operator claims the robot.
        watch: called after each tick of the service with the state it saw.
    """

    config: WbcConfig
    sim: SimConfig = field(default_factory=SimConfig)
    delay_ms: int = 10
    replies: list[GaitReply] = field(default_factory=list)
    states: list[ControllerState] = field(default_factory=list)
    commands: list[JointCommand] = field(default_factory=list)
    claims: bool = True
    watch: Callable[[PlantState], None] | None = None

    def __post_init__(self) -> None:
        self.service = WbcService(self.config)
        self.plant = Plant(self.sim)
        self.inputs = FakeInputs()
        self._pending: deque[tuple[int, JointCommand]] = deque()
        self._events: list[tuple[Topic[Any], Message]] = []
        self._request_id = 0

    def put(self, topic: Topic[Any], message: Message) -> None:
        """Let the next step of the service see a message."""
        self._events.append((topic, message))

    def send(self, message: Setpoint) -> None:
        self.put(TELEOP_SETPOINT, message)

    def ask(self, gait: Gait) -> None:
        self._request_id += 1
        self.put(TELEOP_GAIT, request(self._request_id, gait))

    def tick(self) -> list[Output]:
        """One control period."""
        plant, inputs = self.plant, self.inputs
        inputs.begin_step()
        state = plant.measured()
        inputs.put(PLANT_STATE, state)
        if self.claims:
            inputs.put(TELEOP_CLAIM, claim(len(self.commands)))
        for topic, message in self._events:
            inputs.put(topic, message)
        self._events.clear()
        outputs = list(self.service.step(inputs, plant.now_ns))
        for output in outputs:
            message = output.message
            if output.topic is WBC_COMMAND:
                assert isinstance(message, JointCommand)
                self.commands.append(message)
                self._pending.append((plant.now_ns + self.delay_ms * MS, message))
            elif output.topic is WBC_STATE:
                assert isinstance(message, ControllerState)
                self.states.append(message)
            elif output.topic is WBC_REPLY:
                assert isinstance(message, GaitReply)
                self.replies.append(message)
        if self.watch is not None:
            self.watch(state)
        for _ in range(self.service.period_ns // MS):
            while self._pending and self._pending[0][0] <= plant.now_ns:
                assert plant.offer(self._pending.popleft()[1]), plant.guard.last_refusal
            plant.step()
        return outputs

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9 / self.service.period_ns)):
            self.tick()

    def die(self, seconds: float) -> None:
        """The controller is gone, its last commands are lost; the plant goes on."""
        self._pending.clear()
        for _ in range(round(seconds * 1000.0)):
            self.plant.step()

    def walk(self, gait: Gait) -> None:
        """One gait, from the request to its completion."""
        self.ask(gait)
        self.tick()
        assert self.outcomes()[-1] is GaitOutcome.ACCEPTED, self.replies[-1].reason
        deadline = len(self.states) + 1000
        while self.outcomes()[-1] is not GaitOutcome.COMPLETED:
            assert len(self.states) < deadline, f"{gait.name} is never completed"
            assert not self.plant.fallen, f"fell during {gait.name}"
            self.tick()

    def outcomes(self) -> list[GaitOutcome]:
        return [reply.outcome for reply in self.replies]


def record(config: WbcConfig, sim: SimConfig, stride: int, gaits: Sequence[Gait]) -> list[Tick]:
    """Stand up, walk, stand; every ``stride``-th tick of it."""
    bench = Bench(config, sim)
    solver = RecordingSolver(bench.service.controller.solver)
    bench.service.controller.solver = solver
    ticks: list[Tick] = []

    def keep(state: PlantState) -> None:
        assert solver.last is not None
        ticks.append(Tick(state, *solver.last, bench.states[-1].state, bench.commands[-1]))

    bench.watch = keep
    bench.run(config.stand_time + 0.2)
    for gait in gaits:
        bench.walk(gait)
    bench.run(0.3)
    return ticks[::stride]
