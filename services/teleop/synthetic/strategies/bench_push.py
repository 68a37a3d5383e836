"""bench/push: take the bar with both hands and walk the trolley to its place.

Fists that only lean on the bar slide along it as the torso sways from foot to foot, and turn the
trolley by 10 degrees a gait; hands that grip stay where they are.
"""

import math
from collections.abc import Callable

import numpy as np

from common.robot.pose import Pose
from common.schemas import Gait
from services.teleop.synthetic.observation import Observation, hand_pose
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError
from services.teleop.targets.hand import SIDES

Placing = Callable[[Observation, str, float], Pose]
"""Function from observation, side and distance along the hand's axis [m] to the hand's pose."""
SHORT = 0.045
"""Distance before the goal at which to stop pushing [m]."""
MOST_GAITS = 10
FURTHEST = 0.43
"""Largest x that a hand turned like this reaches at the bar's height [m]."""


def push_cart(operator: OperatorModel) -> Act:
    """Push the trolley to its goal."""
    operator.note = "looking at the trolley"
    operator.gaze = 0.35
    yield from operator.react()
    yield from operator.engage("left", "right")
    yield from take_bar(operator)
    for _ in range(MOST_GAITS):
        ahead = remaining(operator.seen)
        if ahead < SHORT:
            break
        operator.note = f"pushing, {ahead:.2f} m to go"
        yield from operator.gait(Gait.FORWARD)
        yield from operator.react()
    else:
        raise StrategyError(f"the trolley is not at its place after {MOST_GAITS} gaits")
    operator.note = "letting go"
    yield from operator.pause(abs(operator.vary(0.5, 0.3)))
    yield from operator.together(operator.grip("left", 0.0), operator.grip("right", 0.0))
    operator.note = "done"
    return True


def remaining(seen: Observation) -> float:
    """Return the trolley's distance from its goal [m]."""
    return float(seen.pose_of("goal").position[0] - seen.pose_of("cart").position[0])


def take_bar(operator: OperatorModel) -> Act:
    """Grasp the bar with both hands, rolled so that the fingers are above and below it."""
    width, pitch = operator.vary(0.20, 0.01), operator.vary(0.52, 0.03)
    roll, before = operator.vary(1.45, 0.06), operator.vary(0.10, 0.008)

    def at(seen: Observation, side: str, ahead: float) -> Pose:
        sign = 1.0 if side == "left" else -1.0
        bar = seen.torso.local(seen.pose_of("cart_bar").position)
        along = ahead * np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
        x = min(FURTHEST, float(bar[0]))
        pose = hand_pose(x, float(bar[1]) + sign * width, float(bar[2]), sign * roll, pitch)
        return Pose(pose.position + along, pose.quaternion)

    def both(ahead: float, speed: float, tolerance: float) -> Act:
        return operator.together(
            *(_reach(operator, side, at, ahead, speed, tolerance) for side in SIDES)
        )

    operator.note = "hands before the bar"
    yield from operator.together(operator.grip("left", 0.0), operator.grip("right", 0.0))
    yield from both(-before, 0.9, 0.02)
    operator.note = "hands around the bar"
    yield from both(0.0, 0.7, 0.015)
    operator.note = "gripping"
    yield from operator.react()
    yield from operator.together(operator.grip("left", 1.0), operator.grip("right", 1.0))
    return True


def _reach(
    operator: OperatorModel, side: str, at: Placing, ahead: float, speed: float, tolerance: float
) -> Act:
    return operator.reach(
        side,
        lambda seen: at(seen, side, ahead),
        speed=speed,
        tolerance=tolerance,
        angle=0.2,
        corrections=2,
    )
