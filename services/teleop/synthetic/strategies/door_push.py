"""door/push: open the leaf with the left fist, keep it open with the right, and walk through."""

import math

from common.schemas import Gait
from services.teleop.synthetic.observation import Observation, hand_pose
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError

BEYOND = 1.27
"""World x of the torso at which the robot is through [m]."""
LANE = 0.035
"""Best y to walk through [m]; the leaf is on the right, the strike nearer on the left."""
TOO_LEFT, TOO_RIGHT = 0.04, -0.065
"""Limits beside the lane [m], further apart than a side-step, so that none is reversed."""
MOST_GAITS = 12


def push_through(operator: OperatorModel) -> Act:
    """Open the door and walk through."""
    operator.note = "looking at the door"
    operator.gaze = 0.15
    yield from operator.react()
    yield from operator.engage("left", "right")
    yield from operator.together(operator.grip("left", 1.0), operator.grip("right", 1.0))
    yield from left_to_leaf(operator)
    lane = operator.vary(LANE, 0.005)
    right_out = parked = False
    for _ in range(MOST_GAITS):
        seen = operator.seen
        if seen.torso.position[0] > BEYOND:
            break
        opened = seen.joints["door_hinge"]
        if not right_out and opened > math.radians(13.0) and seen.torso.position[0] > 0.35:
            yield from right_to_leaf(operator)
            right_out = True
        if right_out and not parked:
            yield from park_left(operator)
            parked = True
        gait = next_gait(operator.seen, lane)
        operator.note = (
            f"{gait.name.lower().replace('_', ' ')}, leaf {math.degrees(opened):.0f} deg"
        )
        yield from operator.gait(gait)
        yield from operator.react()
    else:
        raise StrategyError(f"not through the door after {MOST_GAITS} gaits")
    operator.note = "done"
    return True


def next_gait(seen: Observation, lane: float) -> Gait:
    """Return the next gait: forward, unless heading or lane must be corrected before the frame."""
    x, y, _ = seen.torso.position.tolist()
    yaw = seen.torso.yaw
    if abs(yaw) > math.radians(9.5):
        return Gait.TURN_RIGHT if yaw > 0.0 else Gait.TURN_LEFT
    drift = y + yaw * max(0.0, 0.7 - x) - lane
    if not TOO_RIGHT < drift < TOO_LEFT and x < 0.9:
        return Gait.SIDE_RIGHT if drift > 0.0 else Gait.SIDE_LEFT
    return Gait.FORWARD


def left_to_leaf(operator: OperatorModel) -> Act:
    """Move the left fist low, below the lever, and out to the leaf."""
    operator.note = "left fist to the leaf"
    y = operator.vary(0.11, 0.01)
    low = hand_pose(0.28, y + 0.02, operator.vary(-0.03, 0.008), 0.0, 0.0, -0.26)
    out = hand_pose(operator.vary(0.42, 0.008), y, operator.vary(-0.01, 0.008), 0.0, 0.0, -0.26)
    yield from operator.reach("left", lambda _: low, tolerance=0.03, angle=0.3, corrections=1)
    yield from operator.reach("left", lambda _: out, tolerance=0.03, angle=0.3, corrections=1)
    return True


def right_to_leaf(operator: OperatorModel) -> Act:
    """Move the right fist out to the right, where it keeps the leaf off the body."""
    operator.note = "right fist to the leaf"
    x, y = operator.vary(0.40, 0.008), operator.vary(-0.40, 0.008)
    pose = hand_pose(x, y, operator.vary(0.06, 0.01), 0.0, 0.0, -0.6)
    yield from operator.reach(
        "right", lambda _: pose, speed=0.8, tolerance=0.05, angle=0.4, corrections=1
    )
    return True


def park_left(operator: OperatorModel) -> Act:
    """Move the left hand close to the body, away from the jamb."""
    operator.note = "left hand in"
    pose = hand_pose(operator.vary(0.26, 0.008), 0.16, -0.05, 0.0, 0.0, -0.1)
    yield from operator.reach("left", lambda _: pose, tolerance=0.05, angle=0.4, corrections=0)
    return True
