"""hardware/cap: hold the can with one hand, grip its cap with the other and pull it off upwards."""

import numpy as np

from common.robot.pose import Pose
from services.teleop.synthetic.observation import Observation, easy_yaw
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError
from services.teleop.targets.hand import hand_quaternion

OFF = 0.06
"""Distance of the cap from its seat at which it is off [m]."""
CAN_HEIGHT = 0.15


def take_cap_off(operator: OperatorModel) -> Act:
    """Take the cap off with two hands."""
    holder, puller = ("left", "right") if operator.chance(0.5) else ("right", "left")
    operator.note = "looking at the can"
    operator.gaze = 0.75
    yield from operator.react()
    yield from operator.engage("left", "right")
    yield from grasp(operator, holder, "can_grip", operator.vary(0.0, 0.006))
    for _ in range(3):
        yield from grasp(operator, puller, "cap_grip", operator.vary(0.004, 0.003))
        yield from pull(operator, puller, holder)
        if off(operator.seen):
            break
        yield from operator.grip(puller, 0.0)
    else:
        raise StrategyError("the cap did not come off in three attempts")
    operator.note = "done"
    return True


def off(seen: Observation) -> bool:
    """Return whether the cap is off the can."""
    can, cap = seen.pose_of("can"), seen.pose_of("cap")
    seat = can.apply(np.array([0.0, 0.0, CAN_HEIGHT]))
    return float(np.linalg.norm(cap.position - seat)) > OFF


def grasp(operator: OperatorModel, side: str, grip: str, height: float) -> Act:
    """Grasp can or cap at the site ``grip``, ``height`` [m] above it."""
    # Both hands are turned inward, the one that reaches across the middle more.
    aside = float(operator.seen.in_body(operator.seen.pose_of(grip)).position[1])
    yaw = easy_yaw(side, aside) + operator.vary(0.0, 0.04)
    before = operator.vary(0.10, 0.006)

    def at(seen: Observation, ahead: float) -> Pose:
        place = seen.torso.local(seen.pose_of(grip).position)
        along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        return Pose(
            place + ahead * along + np.array([0.0, 0.0, height]),
            hand_quaternion(0.0, 0.0, yaw),
        )

    operator.note = f"{side} hand to the {grip.removesuffix('_grip')}"
    yield from operator.grasp(side, at, before, speed=0.7, angle=0.15)
    return True


def pull(operator: OperatorModel, side: str, holder: str) -> Act:
    """Pull the cap up until it is off, while the other hand presses the can down."""
    operator.note = "pulling the cap"
    speed = operator.vary(0.08, 0.015)
    yield from operator.together(
        operator.push(
            side, lambda _: np.array([0.0, 0.0, 1.0]), 0.2, speed=speed, until=off, lead=0.14
        ),
        operator.push(
            holder, lambda _: np.array([0.0, 0.0, -1.0]), 0.1, speed=speed, until=off, lead=0.08
        ),
    )
    return True
