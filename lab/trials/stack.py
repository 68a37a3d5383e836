"""Plant, controller and synthetic operator with one task, in one simulated-time runner."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from time import perf_counter
from typing import Literal

from common.plant.config import TorqueMode
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import TaskStatus, TaskVerdict
from common.topics import TASK_STATUS
from lab.trials.links import links_used
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator
from services.teleop.synthetic.traits import OperatorTraits
from services.wbc.config import wbc_config
from services.wbc.service import WbcService

AFTER = 0.5
"""Run on after the verdict [s]."""


@dataclass(frozen=True)
class TrialSpec:
    """One trial.

    Attributes:
        task: for instance ``door/unlock``.
        seed: of start, noise, links and operator alike.
        traits: of the operator.
        links: delays by name, for instance ``{"both": "250ms"}``; none beside them. None: the
            task's own.
        mode: torque limits of plant and controller.
        pace: of the gaits, as in :func:`services.wbc.config.wbc_config`.
        raw_hands: no interpolation of the hand set-points.
        physics_steps: physics steps a step of the plant's service; more is faster.
    """

    task: str
    seed: int
    traits: OperatorTraits = field(default_factory=OperatorTraits)
    links: Mapping[str, str] | None = None
    mode: Literal["relaxed", "rated"] = "relaxed"
    pace: str = ""
    raw_hands: bool = False
    physics_steps: int = 1


@dataclass(frozen=True)
class TrialResult:
    """What became of a trial.

    Attributes:
        task: its name.
        seed: of the trial.
        verdict: of the task's judge.
        time: until the verdict [s].
        reason: the judge's.
        gave_up: why the operator ended early; empty: it did not.
        doing: what the operator was doing at the end.
        stages: names of the stages done.
        simulated: robot time run in all [s].
        wall: time it took [s].
        links: delays it ran under.
    """

    task: str
    seed: int
    verdict: str
    time: float
    reason: str
    gave_up: str
    doing: str
    stages: tuple[str, ...]
    simulated: float
    wall: float
    links: Mapping[str, str] = field(default_factory=dict)


class TaskStack:
    """A trial under way.

    Attributes:
        spec: as given.
        plant: the plant's service.
        operator: the synthetic operator.
        links: the delays it runs under.
        runner: hosts them.
        status: last status of the task.
    """

    def __init__(
        self, spec: TrialSpec, *, record: bool = False, journal: bool | None = None
    ) -> None:
        """Set the stage; ``record`` and ``journal`` as the runner has them."""
        self.spec = spec
        self.plant = PlantService(
            SimConfig(
                task=spec.task,
                seed=spec.seed,
                torque_mode=TorqueMode(spec.mode),
                physics_steps=spec.physics_steps,
            )
        )
        overrides = {"hands": {"mode": "raw"}} if spec.raw_hands else {}
        self.wbc = WbcService(wbc_config(spec.mode, spec.pace, **overrides))
        self.operator = SyntheticOperator(
            SyntheticConfig(task=spec.task, seed=spec.seed, traits=spec.traits, stay=True)
        )
        self.links = links_used(spec.task, spec.links)
        self.runner = SimTimeRunner(
            [self.plant, self.wbc, self.operator],
            seed=spec.seed,
            links=self.links,
            record=record,
            journal=journal,
        )
        self.status: TaskStatus | None = None
        self.runner.on_message(TASK_STATUS, self._hear)

    def _hear(self, status: TaskStatus) -> None:
        self.status = status

    @property
    def over(self) -> bool:
        """Whether the judge has spoken."""
        return self.status is not None and self.status.verdict is not TaskVerdict.RUNNING

    def run(self) -> TrialResult:
        """Run until the verdict; the time limit of the task ends it in any case."""
        began = perf_counter()
        while not self.over:
            self.runner.run_for(0.1)
        self.runner.run_for(AFTER)
        assert self.status is not None
        return TrialResult(
            task=self.spec.task,
            seed=self.spec.seed,
            verdict=self.status.verdict.name.lower(),
            time=self.status.time,
            reason=self.status.reason,
            gave_up=self.operator.failure,
            doing=self.operator.note,
            stages=tuple(stage.name for stage in self.status.stages if stage.done),
            simulated=self.runner.now_ns * 1e-9,
            wall=perf_counter() - began,
            links=self.links,
        )
