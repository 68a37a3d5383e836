"""bench/push: take the bar with both hands and walk the trolley to its place.

Fists that only lean on the bar slide along it as the torso sways from foot to foot, and turn the
trolley by 10 degrees a gait; hands that grip stay where they are.
"""

import math
from collections.abc import Callable

import numpy as np

from common.robot.pose import Pose
from common.schemas import Gait
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight, hand_pose
from services.teleop.targets.hand import SIDES

Placing = Callable[[Sight, str, float], Pose]
"""A hand's pose by what is seen, side and distance along the hand's axis [m]."""
SHORT = 0.045
"""How far before the goal the trolley may be left [m]."""
MOST_GAITS = 10
FURTHEST = 0.43
"""Before the body a hand turned like this reaches no further at the bar's height [m]."""


def push_cart(person: Person) -> Act:
    """Push the trolley to its goal."""
    person.note = "looking at the trolley"
    person.gaze = 0.35
    yield from person.react()
    yield from person.engage("left", "right")
    yield from take_bar(person)
    for _ in range(MOST_GAITS):
        ahead = remaining(person.sight)
        if ahead < SHORT:
            break
        person.note = f"pushing, {ahead:.2f} m to go"
        yield from person.gait(Gait.FORWARD)
        yield from person.react()
    else:
        raise StrategyError(f"the trolley is not at its place after {MOST_GAITS} gaits")
    person.note = "letting go"
    yield from person.pause(abs(person.vary(0.5, 0.3)))
    yield from person.together(person.grip("left", 0.0), person.grip("right", 0.0))
    person.note = "done"
    return True


def remaining(sight: Sight) -> float:
    """How far the trolley has to go [m]."""
    return float(sight.thing("goal").position[0] - sight.thing("cart").position[0])


def take_bar(person: Person) -> Act:
    """Open hands, rolled so that the fingers are above and below the bar, onto it, and close."""
    width, pitch = person.vary(0.20, 0.01), person.vary(0.52, 0.03)
    roll, before = person.vary(1.45, 0.06), person.vary(0.10, 0.008)

    def at(sight: Sight, side: str, ahead: float) -> Pose:
        sign = 1.0 if side == "left" else -1.0
        bar = sight.torso.local(sight.thing("cart_bar").position)
        along = ahead * np.array([math.cos(pitch), 0.0, -math.sin(pitch)])
        x = min(FURTHEST, float(bar[0]))
        pose = hand_pose(x, float(bar[1]) + sign * width, float(bar[2]), sign * roll, pitch)
        return Pose(pose.position + along, pose.quaternion)

    def both(ahead: float, speed: float, tolerance: float) -> Act:
        return person.together(
            *(_reach(person, side, at, ahead, speed, tolerance) for side in SIDES)
        )

    person.note = "hands before the bar"
    yield from person.together(person.grip("left", 0.0), person.grip("right", 0.0))
    yield from both(-before, 0.9, 0.02)
    person.note = "hands around the bar"
    yield from both(0.0, 0.7, 0.015)
    person.note = "gripping"
    yield from person.react()
    yield from person.together(person.grip("left", 1.0), person.grip("right", 1.0))
    return True


def _reach(
    person: Person, side: str, at: Placing, ahead: float, speed: float, tolerance: float
) -> Act:
    return person.reach(
        side,
        lambda sight: at(sight, side, ahead),
        speed=speed,
        tolerance=tolerance,
        angle=0.2,
        corrections=2,
    )
