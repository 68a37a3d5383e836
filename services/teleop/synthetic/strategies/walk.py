"""door/walk and bench/walk: to the place that the task marks."""

import math

from common.robot.pose import Pose2
from services.teleop.synthetic.observation import Observation, hand_pose
from services.teleop.synthetic.operator_model import Act, OperatorModel
from services.teleop.synthetic.walking import Tolerance, walk_to


def _goal(seen: Observation, ahead: float = 0.0, aside: float = 0.0) -> Pose2:
    mark = seen.pose_of("goal")
    x, y, _ = mark.position.tolist()
    return Pose2(x + ahead, y + aside, mark.yaw)


def walk_to_door(operator: OperatorModel) -> Act:
    """Walk to the door and face it; much nearer, a hand would touch the lever."""
    ahead, aside = operator.vary(0.02, 0.01), operator.vary(0.0, 0.015)
    _goal(operator.seen)  # fails at once if the scene shows no goal
    yield from hands_in(operator)
    yield from _walk(
        operator, ahead, aside, Tolerance(0.07, math.radians(9.0)), by_rule=operator.chance(0.5)
    )
    return True


def hands_in(operator: OperatorModel) -> Act:
    """Draw both hands in, so that none touches the lever when the robot arrives at an angle."""
    operator.note = "hands in"
    yield from operator.react()
    yield from operator.engage("left", "right")
    x, z = operator.vary(0.25, 0.008), operator.vary(-0.04, 0.01)
    left, right = hand_pose(x, 0.2, z), hand_pose(x, -0.2, z)
    yield from operator.together(
        operator.reach("left", lambda _: left, tolerance=0.05, angle=0.4, corrections=0),
        operator.reach("right", lambda _: right, tolerance=0.05, angle=0.4, corrections=0),
    )
    return True


def walk_to_cart(operator: OperatorModel) -> Act:
    """Walk to the place behind the push bar, square to it."""
    yield from _walk(operator, 0.0, 0.0, Tolerance(0.05, math.radians(9.1)), by_rule=False)
    return True


def _walk(
    operator: OperatorModel, ahead: float, aside: float, tolerance: Tolerance, *, by_rule: bool
) -> Act:
    operator.note = "looking around"
    operator.gaze = 0.2
    yield from operator.react()
    yield from operator.engage("left", "right")
    yield from walk_to(operator, lambda seen: _goal(seen, ahead, aside), tolerance, by_rule=by_rule)
    operator.note = "done"
    return True
