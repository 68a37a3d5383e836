"""bench/push: fists against the bar, then walk; steer by reaching further with one hand."""

import math

import numpy as np

from common.schemas import Gait
from services.teleop.hand import SIDES
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Pose, Sight, hand_pose

TIP = 0.035
"""From the hand's frame to the end of the fist [m]."""
BAR_RADIUS = 0.02
SHORT = 0.045
"""How far before the goal the trolley may be left [m]."""
MOST_GAITS = 10


def push_cart(person: Person) -> Act:
    """Push the trolley to its goal."""
    person.note = "looking at the trolley"
    person.gaze = 0.35
    width = person.vary(0.215, 0.008)
    pitch, height = person.vary(0.3, 0.03), person.vary(0.0, 0.004)
    press = person.vary(0.015, 0.005)
    yield from person.react()
    yield from person.engage("left", "right")
    person.note = "fists before the bar"
    yield from person.together(person.grip("left", 1.0), person.grip("right", 1.0))
    yield from _place(person, width, pitch, height, -0.045, 0.0)
    person.note = "fists on the bar"
    yield from _place(person, width, pitch, height, press, 0.0)
    for _ in range(MOST_GAITS):
        ahead, turned = remaining(person.sight)
        if ahead < SHORT:
            break
        person.note = f"pushing, {ahead:.2f} m to go"
        yield from person.gait(steering(person.sight))
        yield from person.react()
        _, turned = remaining(person.sight)
        if abs(turned) > math.radians(2.5):
            yield from _place(person, width, pitch, height, press, turned)
    else:
        raise StrategyError(f"the trolley is not at its place after {MOST_GAITS} gaits")
    person.note = "done"
    return True


def remaining(sight: Sight) -> tuple[float, float]:
    """How far the trolley has to go [m], and its heading from the goal's [rad]."""
    cart, goal = sight.thing("cart"), sight.thing("goal")
    return (
        float(goal.position[0] - cart.position[0]),
        math.remainder(cart.yaw - goal.yaw, math.tau),
    )


def steering(sight: Sight) -> Gait:
    """Ahead; a turn where the robot itself has lost its heading."""
    yaw = sight.torso.yaw
    if abs(yaw) > math.radians(11.0):
        return Gait.TURN_RIGHT if yaw > 0.0 else Gait.TURN_LEFT
    return Gait.FORWARD


def _place(
    person: Person, width: float, pitch: float, height: float, ahead: float, turned: float
) -> Act:
    """Both fists to the bar's height, ``ahead`` of touching it; the lagging end gets more."""

    def goal(side: str, sight: Sight) -> Pose:
        sign = 1.0 if side == "left" else -1.0
        bar = sight.torso.local(sight.thing("cart_bar").position)
        more = float(np.clip(0.15 * turned * sign, -0.02, 0.02))
        x = min(0.385, float(bar[0]) - BAR_RADIUS - TIP * math.cos(pitch) + ahead + more)
        z = float(bar[2]) + height + TIP * math.sin(pitch)
        return hand_pose(x, sign * width, z, 0.0, pitch)

    yield from person.together(
        *(
            person.reach(
                side,
                lambda sight, side=side: goal(side, sight),  # type: ignore[misc]
                speed=0.9,
                tolerance=0.03,
                angle=0.3,
                corrections=1 if ahead < 0.0 else 0,
            )
            for side in SIDES
        )
    )
    return True
