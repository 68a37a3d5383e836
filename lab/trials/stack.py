"""Hosts plant, controller and synthetic operator with one task in simulated time."""

from time import perf_counter

from common.plant.config import TorqueMode
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import TaskStatus, TaskVerdict
from common.topics import TASK_STATUS
from lab.trials.links import links_used
from lab.trials.spec import TrialResult, TrialSpec
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator
from services.wbc.config import wbc_config
from services.wbc.service import WbcService

SECONDS_AFTER_VERDICT = 0.5
"""A trial runs on for so long after its verdict [s]."""


class TaskStack:
    """One trial, from its start until its verdict.

    Attributes:
        spec: the trial.
        plant: the plant's service.
        wbc: the controller's service.
        operator: the synthetic operator's service.
        links: the delays under which the trial runs.
        runner: hosts the services.
        status: the task's last status; None before the first.
    """

    def __init__(
        self, spec: TrialSpec, *, record: bool = False, journal: bool | None = None
    ) -> None:
        """Build the services; ``record`` and ``journal`` are options of the runner."""
        self.spec = spec
        self.plant = PlantService(
            SimConfig(
                task=spec.task,
                seed=spec.seed,
                torque_mode=TorqueMode(spec.torque_mode),
                physics_steps=spec.physics_steps,
            )
        )
        overrides = {"hands": {"mode": "raw"}} if spec.raw_hands else {}
        self.wbc = WbcService(wbc_config(spec.torque_mode, spec.pace, **overrides))
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
        self.runner.on_message(TASK_STATUS, self._on_status)

    def _on_status(self, status: TaskStatus) -> None:
        self.status = status

    @property
    def over(self) -> bool:
        """Whether the judge has given its verdict."""
        return self.status is not None and self.status.verdict is not TaskVerdict.RUNNING

    def run(self) -> TrialResult:
        """Run until the verdict; the time limit of the task ends the trial in any case."""
        began = perf_counter()
        while not self.over:
            self.runner.run_for(0.1)
        self.runner.run_for(SECONDS_AFTER_VERDICT)
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
