"""Runs one trial of the study and measures it."""

from time import perf_counter

from common.errors import TrillError
from common.schemas import Setpoint, TaskStatus
from common.topics import JOURNAL, PLANT_STATE, TELEOP_SETPOINT
from lab.errors import LatencyStudyError, StoppedError
from lab.studies.latency.conditions import COMMAND_INPUT, FEEDBACK_INPUT
from lab.studies.latency.latencies import Latencies
from lab.studies.latency.motion import Motion
from lab.studies.latency.plan import Plan, TrialKey, source
from lab.studies.latency.row import TrialRow, judged, link_take
from lab.trials.spec import TrialResult
from lab.trials.stack import TaskStack
from lab.trials.workers import stop_wanted
from services.sim.tasks import find_task


class Measurer:
    """Listens to one trial.

    Attributes:
        latencies: of everything the services took in.
        motion: of the hands.
    """

    def __init__(self, stack: TaskStack) -> None:
        self.latencies = Latencies()
        self.motion = Motion()
        stack.runner.on_message(JOURNAL, self.latencies.add)
        stack.runner.on_message(TELEOP_SETPOINT, self._setpoint)
        stack.runner.on_message(PLANT_STATE, self.motion.measured)

    def _setpoint(self, setpoint: Setpoint) -> None:
        if stop_wanted():
            raise StoppedError("the trial was given up")
        self.motion.told(setpoint)


def run_study_trial(plan: Plan, key: TrialKey) -> TrialRow:
    """Run one trial and measure it; if its simulation fails the verdict is ``error``.

    Raises:
        StoppedError: the worker is to end meanwhile.
        LatencyStudyError: this process runs other code than the study was begun with.
    """
    here = source()
    if plan.versions.get("source", here) != here:
        raise LatencyStudyError(
            f"the code was edited while the study ran: expected {plan.versions['source']}, got "
            f"{here}; undo the edit and give the same command again, or choose another --out"
        )
    began = perf_counter()
    stack = TaskStack(plan.spec(key), journal=True)
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
    condition = plan.condition(key.condition)
    measured = {
        "task": key.task,
        "condition": key.condition,
        "seed": key.seed,
        "limit": find_task(key.task).limit,
        "command": link_take(measurer.latencies, condition, COMMAND_INPUT),
        "feedback": link_take(measurer.latencies, condition, FEEDBACK_INPUT),
        "hand_path": measurer.motion.hand_path,
        "arm_acceleration": measurer.motion.arm_acceleration,
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
