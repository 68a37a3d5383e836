"""Hosts plant, controller and an operator with one task in simulated time."""

from collections.abc import Sequence
from time import perf_counter

import numpy as np

from common.errors import TrillError
from common.plant.config import PHYSICS_STEP_NS, TorqueMode
from common.ports import Role, with_role
from common.runtime.service import Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import TaskStatus, TaskVerdict
from common.topics import TASK_STATUS
from lab.errors import StoppedError
from lab.trials.links import links_used
from lab.trials.operators.kinds import build_operator
from lab.trials.spec import TrialResult, TrialSpec
from lab.trials.workers import Stop, stop_request
from services.sim.config import SimConfig
from services.sim.service import PlantService
from services.wbc.config import wbc_config
from services.wbc.service import WbcService

SENSORS = with_role(Role.SENSOR)
_CAMERA_STREAM = 0xCA3E
"""Separates the random numbers of the cameras' first tick from those of the trial."""
SECONDS_AFTER_VERDICT = 0.5
"""A trial runs on for so long after its verdict [s]."""


def camera_offset_ns(seed: int, period_ns: int) -> int:
    """Return when the cameras of a trial take their first picture, within a period [ns].

    Nothing synchronises them with plant and operator: each trial draws its own, in whole physics
    steps.
    """
    steps = np.random.default_rng((seed, _CAMERA_STREAM)).integers(period_ns // PHYSICS_STEP_NS)
    return int(steps) * PHYSICS_STEP_NS


class TaskStack:
    """One trial, from its start until its verdict.

    Attributes:
        spec: the trial.
        plant: the plant's service.
        wbc: the controller's service.
        operator: tells what the operator is doing.
        cameras: the cameras' service; None: there is none.
        links: the delays under which the trial runs.
        runner: hosts the services.
        status: the task's last status; None before the first.
    """

    def __init__(
        self,
        spec: TrialSpec,
        *,
        cameras: Service | None = None,
        beside: Sequence[Service] = (),
        record: bool = False,
        journal: bool | None = None,
    ) -> None:
        """Build the services.

        Args:
            spec: the trial.
            cameras: cameras of a trial whose operator brings none; it has some if it sees.
            beside: services to run beside them, after the cameras and before the operator at equal
                times.
            record: option of the runner.
            journal: option of the runner.
        """
        self.spec = spec
        self.plant = PlantService(
            SimConfig(
                task=spec.task,
                seed=spec.seed,
                torque_mode=TorqueMode(spec.torque_mode),
                physics_steps=spec.physics_steps,
                task_spread=spec.task_spread,
            )
        )
        overrides = {"hands": {"mode": "raw"}} if spec.raw_hands else {}
        self.wbc = WbcService(wbc_config(spec.torque_mode, spec.pace, **overrides))
        self.operator, services = build_operator(spec)
        own = [service for service in services if service.name in SENSORS]
        self.cameras = own[0] if own else cameras
        seeing = () if self.cameras is None else (self.cameras,)
        around = (*seeing, *beside, *(service for service in services if service not in own))
        self.links = links_used(spec.task, spec.links)
        self.runner = SimTimeRunner(
            [self.plant, self.wbc, *around],
            seed=spec.seed,
            links=self.links,
            offsets_ns={
                service.name: camera_offset_ns(spec.seed, service.period_ns)
                for service in around
                if service.name in SENSORS
            },
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

    def run(self, stop: Stop | None = None) -> TrialResult:
        """Run until the verdict and close the services.

        The time limit of the task ends the trial in any case.

        Args:
            stop: requests that the trial is given up; None: the request to this process.

        Raises:
            StoppedError: the trial was given up.
        """
        stop = stop or stop_request()
        began = perf_counter()
        try:
            while not self.over:
                if stop.is_set():
                    raise StoppedError("the trial was given up")
                self.runner.run_for(0.1)
            self.runner.run_for(SECONDS_AFTER_VERDICT)
        finally:
            self.runner.close()
        assert self.status is not None
        verdict = self.status.verdict.name.lower()
        return self._result(verdict, self.status.reason, perf_counter() - began)

    def run_or_error(self, stop: Stop | None = None) -> TrialResult:
        """Run the trial like :meth:`run`; if its simulation fails, the verdict is ``error``.

        Raises:
            StoppedError: the trial was given up.
        """
        began = perf_counter()
        try:
            result = self.run(stop)
        except StoppedError:
            raise
        except TrillError as error:
            reason = f"{type(error).__name__}: {error}"[:400]
            return self._result("error", reason, perf_counter() - began)
        if self.plant.plant.reset_count:
            reason = "the physics diverged and the plant was reset"
            return result.model_copy(update={"verdict": "error", "reason": reason})
        return result

    def _result(self, verdict: str, reason: str, wall: float) -> TrialResult:
        status = self.status
        stages = [] if status is None else status.stages
        return TrialResult(
            task=self.spec.task,
            seed=self.spec.seed,
            verdict=verdict,
            time=0.0 if status is None else status.time,
            reason=reason,
            gave_up=self.operator.failure,
            doing=self.operator.note,
            stages=tuple(stage.name for stage in stages if stage.done),
            simulated=self.runner.now_ns * 1e-9,
            wall=wall,
            links=self.links,
        )
