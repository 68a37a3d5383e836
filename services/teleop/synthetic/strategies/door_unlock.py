"""door/unlock: press the lever down with the left fist, then push the leaf ajar.

The leaf is pushed with the same fist or, in some trials, with the other one if it is in reach.
"""

import numpy as np

from common.robot.pose import Pose
from common.robot.rotations import conjugate, rotate_vector
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.observation import Observation, easy_yaw, hand_pose
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError
from services.teleop.targets.hand import hand_quaternion

PRESSED = 0.5
"""Lever angle that frees the bolt, with a margin for the lever to rise a little [rad]."""
AJAR = 0.055
"""Leaf angle at which to stop pushing [rad]."""
LEAD = 0.17
"""Lead of the own hand in contact [m]; it makes the force, about 80 N/m."""
DOWN = (0.12, 0.0, -0.993)
"""Direction of pressing: a little forward, for a pressed hand yields backward off the lever."""
FURTHEST = 0.425
"""Largest x at which a hand can still push [m]."""
SIDE = "left"
OTHER = "right"
TWO_HANDED = 0.45
"""Probability that the other hand pushes the leaf, if it reaches it."""
NEAR = 0.45
"""Largest distance to the leaf at which the other arm reaches it [m]."""
LEVER_BEFORE_LEAF = 0.06
"""Distance from the lever's middle to the leaf's front [m]."""
BEFORE_LEAF = 0.08
"""Distance from the leaf's front to the ready fist [m]."""


def level_hand(seen: Observation, point: Array, roll: float = 0.0) -> Pose:
    """Return the level fist at a point (3,) of the world, at an easy yaw, in the body frame."""
    place = np.minimum(seen.torso.local(point), (FURTHEST, np.inf, np.inf))
    yaw = easy_yaw(SIDE, float(place[1]))
    return Pose(place, hand_quaternion(roll, 0.0, yaw))


def in_body(seen: Observation, direction: tuple[float, float, float]) -> Array:
    """Return a direction of the world (3,) in the body frame."""
    return rotate_vector(conjugate(seen.torso.quaternion), np.array(direction))


def unlock(operator: OperatorModel) -> Act:
    """Unlock the door and draw the hand back."""
    operator.note = "looking at the lever"
    yield from operator.react()
    yield from operator.engage("left", "right")
    two_handed = operator.chance(TWO_HANDED) and leaf_ahead(operator.seen) < NEAR
    if two_handed:
        yield from ready_at_leaf(operator)
    for attempt in range(4):
        pusher = OTHER if two_handed and attempt == 0 else SIDE
        opened = yield from press_and_push(operator, pusher, first=attempt == 0)
        if opened:
            break
        operator.note = "once more"
        yield from draw_back(operator)
    else:
        raise StrategyError("the door did not open in four attempts")
    yield from operator.pause(max(0.0, operator.vary(0.2, 0.15)))
    yield from draw_back(operator)
    operator.note = "done"
    return True


def press_and_push(operator: OperatorModel, pusher: str, *, first: bool) -> Act:
    """Press the lever and push the leaf; succeeds if the leaf opens.

    Args:
        operator: model of the person.
        pusher: side of the hand that pushes the leaf.
        first: whether this is the first attempt; at a later one the hand stops beside the lever.
    """
    yield from above_lever(operator, first=first)
    operator.note = "pressing the lever"
    pressed = yield from operator.push(
        SIDE,
        lambda seen: in_body(seen, DOWN),
        0.27,
        speed=operator.vary(0.13, 0.02),
        until=lambda seen: seen.joints["door_lever"] > PRESSED,
        lead=LEAD,
    )
    if not pressed:
        return False
    if operator.chance(0.3):
        yield from operator.pause(abs(operator.vary(0.0, 0.2)))
    operator.note = f"pushing the leaf, {pusher} fist"
    opened = yield from operator.push(
        pusher,
        lambda seen: in_body(seen, (1.0, 0.0, 0.0)),
        0.25,
        speed=operator.vary(0.15, 0.02),
        until=lambda seen: seen.joints["door_hinge"] > AJAR,
        lead=LEAD,
    )
    return opened


def above_lever(operator: OperatorModel, *, first: bool) -> Act:
    """Move the fist above the lever, from beside it.

    From the front the fist would meet the lever, for close to the body the arm does not reach high.
    """
    aside, ahead = operator.vary(0.006, 0.008), operator.vary(0.014, 0.006)
    hover = operator.vary(0.07, 0.006)
    before, outside = operator.vary(0.03, 0.01), operator.vary(0.20, 0.012)
    roll = operator.vary(0.0, 0.06)
    rest = operator.seen.pose_of("lever_grip").position
    operator.note = "to the lever"

    def beside(seen: Observation) -> Pose:
        return level_hand(seen, rest + np.array([-before, outside, hover]), roll)

    def above(seen: Observation) -> Pose:
        return level_hand(seen, rest + np.array([ahead, aside, hover]), roll)

    through = first and not operator.chance(0.4)
    yield from operator.together(
        operator.grip(SIDE, 1.0),
        operator.reach(
            SIDE, beside, speed=operator.vary(1.1, 0.15), tolerance=0.04, through=through
        ),
    )
    yield from operator.reach(
        SIDE, above, speed=operator.vary(0.9, 0.12), tolerance=0.02, corrections=2
    )
    return True


def leaf_ahead(seen: Observation) -> float:
    """Return the distance from the torso to the leaf's front [m]."""
    return float(
        seen.pose_of("lever_grip").position[0] + LEVER_BEFORE_LEAF - seen.torso.position[0]
    )


def ready_at_leaf(operator: OperatorModel) -> Act:
    """Move the right fist before the leaf, to push when the lever is down."""
    height, aside = operator.vary(0.04, 0.015), operator.vary(-0.12, 0.015)
    operator.note = "right fist to the leaf"

    def ready(seen: Observation) -> Pose:
        ahead = min(FURTHEST, leaf_ahead(seen) - BEFORE_LEAF)
        return hand_pose(ahead, aside, height, 0.0, 0.0, easy_yaw(OTHER, aside))

    yield from operator.together(
        operator.grip(OTHER, 1.0),
        operator.reach(OTHER, ready, speed=operator.vary(1.1, 0.15), tolerance=0.04, corrections=1),
    )
    return True


def draw_back(operator: OperatorModel) -> Act:
    """Draw the hand straight back from the lever; raising it would lift the lever."""
    distance = operator.vary(0.13, 0.015)

    def back(seen: Observation) -> Pose:
        here = seen.hands[SIDE]
        return Pose(here.position + in_body(seen, (-distance, 0.0, 0.0)), here.quaternion)

    goal = back(operator.seen)
    yield from operator.reach(SIDE, lambda _: goal, tolerance=0.05, corrections=1)
    return True
