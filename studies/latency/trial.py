"""Runs one trial of the study and measures it."""

from time import perf_counter

import numpy as np

from common.errors import TrillError
from common.robot.joints import JOINTS
from common.schemas import PlantState, Setpoint, StepJournal, TaskStatus
from common.schemas.arrays import Float64Array as Array
from common.topics import JOURNAL, PLANT_STATE, TELEOP_SETPOINT
from services.sim.tasks import find_task
from studies.latency.conditions import COMMAND_INPUT, FEEDBACK_INPUT
from studies.latency.errors import StoppedError
from studies.latency.latencies import Latencies
from studies.latency.plan import Cell, Plan
from studies.latency.row import Touched, TrialRow, link_take
from studies.tasks.stack import TaskStack, TrialResult
from studies.workers import stop_wanted

_ARMS = np.array([i for i, joint in enumerate(JOINTS) if joint.group.endswith("arm")])


class Measurer:
    """Listens to one trial.

    Attributes:
        latencies: of everything the services took in.
    """

    def __init__(self, stack: TaskStack) -> None:
        self.latencies = Latencies()
        self._hands: Array | None = None
        self._path = 0.0
        self._state: PlantState | None = None
        self._squares, self._states = 0.0, 0
        stack.runner.on_message(JOURNAL, self._journal)
        stack.runner.on_message(TELEOP_SETPOINT, self._setpoint)
        stack.runner.on_message(PLANT_STATE, self._measured)

    @property
    def hand_path(self) -> float:
        """How far both hands were told to go, in the body frame [m]."""
        return self._path

    @property
    def arm_acceleration(self) -> float | None:
        """Root mean square of the arms' joint accelerations [rad/s²]."""
        return float(np.sqrt(self._squares / self._states)) if self._states else None

    def _journal(self, journal: StepJournal) -> None:
        self.latencies.add(journal)

    def _setpoint(self, setpoint: Setpoint) -> None:
        if stop_wanted():
            raise StoppedError("the trial was given up")
        hands = np.array(
            [setpoint.left_hand_position_in_body, setpoint.right_hand_position_in_body]
        )
        if self._hands is not None:
            self._path += float(np.linalg.norm(hands - self._hands, axis=1).sum())
        self._hands = hands

    def _measured(self, state: PlantState) -> None:
        last, self._state = self._state, state
        if last is None or self._hands is None:
            return
        elapsed = 1e-9 * (state.header.stamp - last.header.stamp)
        if elapsed <= 0.0:
            return
        change = (state.joint_velocity - last.joint_velocity)[_ARMS] / elapsed
        self._squares += float(np.mean(change**2))
        self._states += 1


def run_cell(plan: Plan, cell: Cell) -> TrialRow:
    """Run one trial; one whose simulation fails has the verdict ``error``.

    Raises:
        StoppedError: an end is wanted meanwhile.
    """
    began = perf_counter()
    stack = TaskStack(plan.spec(cell), journal=True)
    measurer = Measurer(stack)
    try:
        result = stack.run()
        failed = "the physics diverged" if stack.plant.plant.reset_count else ""
    except StoppedError:
        raise
    except TrillError as error:
        result, failed = None, f"{type(error).__name__}: {error}"[:400]
    finally:
        stack.runner.close()
    condition = plan.condition(cell.condition)
    measured = {
        "task": cell.task,
        "condition": cell.condition,
        "seed": cell.seed,
        "limit": find_task(cell.task).limit,
        "command": link_take(measurer.latencies, condition, COMMAND_INPUT),
        "feedback": link_take(measurer.latencies, condition, FEEDBACK_INPUT),
        "hand_path": measurer.hand_path,
        "arm_acceleration": measurer.arm_acceleration,
        "simulated": stack.runner.now_ns * 1e-9,
        "wall": perf_counter() - began,
    }
    return TrialRow.model_validate(measured | _ended(result, stack.status, failed))


def _ended(result: TrialResult | None, status: TaskStatus | None, failed: str) -> dict[str, object]:
    """How it came out."""
    time = 0.0 if status is None else status.time
    if result is None or status is None or failed:
        return {"verdict": "error", "reason": failed, "reached": False, "time": time}
    said = {"verdict": result.verdict, "reason": result.reason, "time": result.time}
    return said | {"gave_up": result.gave_up, "doing": result.doing} | judged(status)


def judged(status: TaskStatus) -> dict[str, object]:
    """What the judge's last word says of stages and contacts."""
    return {
        "reached": bool(status.stages) and status.stages[-1].done,
        "stages": tuple(stage.name for stage in status.stages if stage.done),
        "undesired": tuple(
            Touched(name=touch.name, since=touch.since, peak=touch.peak)
            for touch in status.undesired
        ),
    }
