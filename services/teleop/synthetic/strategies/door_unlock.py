"""door/unlock: press the lever down with the left fist, then push the leaf ajar.

The leaf is pushed with the same fist or, by some and where the arm reaches so far, with the other.
"""

import numpy as np

from common.robot.pose import Pose
from common.robot.rotations import conjugate, rotate_vector
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight, easy_yaw, hand_pose

PRESSED = 0.5
"""Lever angle that frees the bolt, with room for the lever to rise a little [rad]."""
AJAR = 0.055
"""Leaf angle at which to stop pushing [rad]."""
LEAD = 0.17
"""How far the own hand may be ahead in contact [m]: the force, some 80 N/m, comes of it."""
DOWN = (0.12, 0.0, -0.993)
"""A little forward: a pressed hand yields backward and would slip off the lever."""
FURTHEST = 0.425
"""Before the body a hand still has room to push [m]."""
SIDE = "left"
OTHER = "right"
TWO_HANDED = 0.45
"""How often one hand presses the lever and the other pushes the leaf, where it reaches so far."""
NEAR = 0.45
"""From further off the other arm is stretched before the bolt is past the strike [m]."""
LEVER_BEFORE_LEAF = 0.06
"""From the lever's middle to the leaf's front [m]."""
BEFORE_LEAF = 0.08
"""From the leaf's front to the ready fist [m]."""


def level_hand(sight: Sight, point: Array, roll: float = 0.0) -> Pose:
    """The fist at a point (3,) of the world, level and turned as is easy, in the body frame."""
    place = np.minimum(sight.torso.local(point), (FURTHEST, np.inf, np.inf))
    yaw = easy_yaw(SIDE, float(place[1]))
    return Pose(place, hand_pose(0.0, 0.0, 0.0, roll, 0.0, yaw).quaternion)


def in_body(sight: Sight, direction: tuple[float, float, float]) -> Array:
    """A direction of the world (3,) in the body frame."""
    return rotate_vector(conjugate(sight.torso.quaternion), np.array(direction))


def unlock(person: Person) -> Act:
    """Unlock the door and draw the hand back."""
    person.note = "looking at the lever"
    yield from person.react()
    yield from person.engage("left", "right")
    two_handed = person.chance(TWO_HANDED) and leaf_ahead(person.sight) < NEAR
    if two_handed:
        yield from ready_at_leaf(person)
    for attempt in range(4):
        pusher = OTHER if two_handed and attempt == 0 else SIDE
        opened = yield from press_and_push(person, pusher, first=attempt == 0)
        if opened:
            break
        person.note = "once more"
        yield from draw_back(person)
    else:
        raise StrategyError("the door did not open in four attempts")
    yield from person.pause(max(0.0, person.vary(0.2, 0.15)))
    yield from draw_back(person)
    person.note = "done"
    return True


def press_and_push(person: Person, pusher: str, *, first: bool) -> Act:
    """Come from beside the lever, lay the fist on it, press, and push; whether the leaf opened.

    From the front the fist would meet the lever: close to the body the arm does not reach high.

    Args:
        person: the operator.
        pusher: the hand that pushes the leaf.
        first: whether this is the first attempt; at a later one it looks before it presses.
    """
    aside, ahead = person.vary(0.006, 0.008), person.vary(0.014, 0.006)
    hover = person.vary(0.07, 0.006)
    before, outside = person.vary(0.03, 0.01), person.vary(0.20, 0.012)
    roll = person.vary(0.0, 0.06)
    rest = person.sight.thing("lever_grip").position
    person.note = "to the lever"

    def beside(sight: Sight) -> Pose:
        return level_hand(sight, rest + np.array([-before, outside, hover]), roll)

    def above(sight: Sight) -> Pose:
        return level_hand(sight, rest + np.array([ahead, aside, hover]), roll)

    stop = not first or person.chance(0.4)
    yield from person.together(
        person.grip(SIDE, 1.0),
        person.reach(
            SIDE,
            beside,
            speed=person.vary(1.1, 0.15),
            tolerance=0.04,
            through=not stop,
        ),
    )
    yield from person.reach(
        SIDE, above, speed=person.vary(0.9, 0.12), tolerance=0.02, corrections=2
    )
    person.note = "pressing the lever"
    pressed = yield from person.push(
        SIDE,
        lambda sight: in_body(sight, DOWN),
        0.27,
        speed=person.vary(0.13, 0.02),
        until=lambda sight: sight.joints["door_lever"] > PRESSED,
        lead=LEAD,
    )
    if not pressed:
        return False
    if person.chance(0.3):
        yield from person.pause(abs(person.vary(0.0, 0.2)))
    person.note = f"pushing the leaf, {pusher} fist"
    opened = yield from person.push(
        pusher,
        lambda sight: in_body(sight, (1.0, 0.0, 0.0)),
        0.25,
        speed=person.vary(0.15, 0.02),
        until=lambda sight: sight.joints["door_hinge"] > AJAR,
        lead=LEAD,
    )
    return opened


def leaf_ahead(sight: Sight) -> float:
    """From the torso to the leaf's front [m]."""
    return float(
        sight.thing("lever_grip").position[0] + LEVER_BEFORE_LEAF - sight.torso.position[0]
    )


def ready_at_leaf(person: Person) -> Act:
    """The right fist before the leaf, to push when the lever is down."""
    height, aside = person.vary(0.04, 0.015), person.vary(-0.12, 0.015)
    person.note = "right fist to the leaf"

    def ready(sight: Sight) -> Pose:
        ahead = min(FURTHEST, leaf_ahead(sight) - BEFORE_LEAF)
        return hand_pose(ahead, aside, height, 0.0, 0.0, easy_yaw(OTHER, aside))

    yield from person.together(
        person.grip(OTHER, 1.0),
        person.reach(OTHER, ready, speed=person.vary(1.1, 0.15), tolerance=0.04, corrections=1),
    )
    return True


def draw_back(person: Person) -> Act:
    """Take the hand straight back from the lever; raising it would hook the lever."""
    distance = person.vary(0.13, 0.015)

    def back(sight: Sight) -> Pose:
        here = sight.hands[SIDE]
        return Pose(here.position + in_body(sight, (-distance, 0.0, 0.0)), here.quaternion)

    goal = back(person.sight)
    yield from person.reach(SIDE, lambda _: goal, tolerance=0.05, corrections=1)
    return True
