"""What the pages are told about robot and operator; pure."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from common.schemas import ControllerState, GuardMode, PlantStatus, TaskStatus
from services.teleop.headset.driver import Driver
from services.teleop.headset.hub import Refusals
from services.teleop.headset.view import in_picture, seen_from
from services.teleop.targets.hand import SIDES


@dataclass(frozen=True)
class Feedback:
    """The robot's latest messages; None: none, or none lately.

    Attributes:
        controller, plant, task: as named.
        neck: pitch of the robot's head [rad].
        cameras: what is wrong with the pictures, in words; empty: nothing.
        refusals: what the server refused.
    """

    controller: ControllerState | None = None
    plant: PlantStatus | None = None
    task: TaskStatus | None = None
    neck: float = 0.0
    cameras: str = ""
    refusals: Refusals = field(default_factory=Refusals)


def describe(driver: Driver, feedback: Feedback, now_ns: int) -> dict[str, Any]:
    """Return the status as a JSON object; ``now_ns`` is the operator's time [ns]."""
    console, claimant = driver.console, driver.console.claimant
    return {
        "robot": _robot(feedback),
        "stop": _stop(driver, feedback, now_ns),
        "operator": {
            "has_robot": claimant.has_robot,
            "asks": claimant.asked is not None,
            "holder": claimant.holder,
            "why": claimant.waits_for(),
            "headset": driver.headset,
            "alive": driver.alive(now_ns),
            "pages": len(driver.pages),
            "notice": console.notice,
            "gaits": [request.describe(1e-9 * now_ns) for request in console.requests],
            "selected": list(console.selected),
        },
        "hands": _hands(driver, feedback),
        "cameras": feedback.cameras,
        "task": _task(feedback.task),
        "refused": asdict(feedback.refusals),
    }


def _robot(feedback: Feedback) -> dict[str, Any]:
    state, plant = feedback.controller, feedback.plant
    told: dict[str, Any] = {"state": "", "guard": "", "neck": round(feedback.neck, 4)}
    if state is not None:
        told |= {
            "state": state.state.name,
            "gait": state.gait.name.lower().replace("_", " ") if state.gait else "",
            "progress": round(state.gait_progress, 2),
            "completed": state.gaits_completed,
            "holds": not state.setpoint_fresh,
            "obstacle": state.obstacle,
        }
    if plant is not None:
        told |= {
            "guard": plant.guard.name,
            "fallen": plant.fallen,
            "paused": plant.paused,
            "pace": round(plant.real_time_factor, 2),
        }
    return told


def _stop(driver: Driver, feedback: Feedback, now_ns: int) -> str:
    """Say that the robot is stopped, or is to be; empty: it is not."""
    pressed_ns, plant = driver.console.button.pressed_ns, feedback.plant
    if pressed_ns is not None:
        return f"stop sent, not confirmed for {1e-9 * (now_ns - pressed_ns):.1f} s"
    if plant is None or plant.guard is not GuardMode.ESTOP:
        return ""
    reason = f": {plant.stop_reason}" if plant.stop_reason else ""
    return f"stopped by {plant.stopped_by or 'somebody'}{reason}"


def _hands(driver: Driver, feedback: Feedback) -> dict[str, Any]:
    """Return where the commanded hands are, in metres before the cameras and in the pictures."""
    target = driver.setpoint(0)
    positions = (target.left_hand_position_in_body, target.right_hand_position_in_body)
    hands = {}
    for index, side in enumerate(SIDES):
        seen = {eye: seen_from(eye, feedback.neck, positions[index]) for eye in SIDES}
        error = feedback.controller.hand_position_error[index] if feedback.controller else 0.0
        hands[side] = {
            "seen": {eye: _rounded(point.tolist()) for eye, point in seen.items()},
            "picture": {eye: in_picture(point) for eye, point in seen.items()},
            "closure": round(float(target.gripper_closure[index]), 3),
            "error": round(float(error), 4),
        }
    return hands


def _task(task: TaskStatus | None) -> dict[str, Any] | None:
    if task is None:
        return None
    return {
        "name": task.task,
        "time": round(task.time, 1),
        "limit": task.limit,
        "verdict": task.verdict.name,
        "reason": task.reason,
        "stages": [[stage.name, stage.done] for stage in task.stages],
    }


def _rounded(values: Sequence[float]) -> list[float]:
    return [round(value, 4) for value in values]
