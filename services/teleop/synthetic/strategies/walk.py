"""door/walk and bench/walk: to the place that the task marks."""

import math

from common.robot.pose import Pose2
from services.teleop.synthetic.person import Act, Person
from services.teleop.synthetic.sight import Sight, hand_pose
from services.teleop.synthetic.walking import Tolerance, walk_to


def _goal(sight: Sight, ahead: float = 0.0, aside: float = 0.0) -> Pose2:
    mark = sight.thing("goal")
    x, y, _ = mark.position.tolist()
    return Pose2(x + ahead, y + aside, mark.yaw)


def walk_to_door(person: Person) -> Act:
    """To the door, facing it; much nearer, a hand would touch the lever."""
    ahead, aside = person.vary(0.02, 0.01), person.vary(0.0, 0.015)
    _goal(person.sight)  # It knows where to before it moves at all.
    yield from hands_in(person)
    yield from _walk(
        person, ahead, aside, Tolerance(0.07, math.radians(9.0)), by_rule=person.chance(0.5)
    )
    return True


def hands_in(person: Person) -> Act:
    """Both hands close to the body: walking up at an angle, one reached the lever."""
    person.note = "hands in"
    yield from person.react()
    yield from person.engage("left", "right")
    x, z = person.vary(0.25, 0.008), person.vary(-0.04, 0.01)
    left, right = hand_pose(x, 0.2, z), hand_pose(x, -0.2, z)
    yield from person.together(
        person.reach("left", lambda _: left, tolerance=0.05, angle=0.4, corrections=0),
        person.reach("right", lambda _: right, tolerance=0.05, angle=0.4, corrections=0),
    )
    return True


def walk_to_cart(person: Person) -> Act:
    """To the place behind the push bar, square to it."""
    yield from _walk(person, 0.0, 0.0, Tolerance(0.05, math.radians(9.1)), by_rule=False)
    return True


def _walk(
    person: Person, ahead: float, aside: float, tolerance: Tolerance, *, by_rule: bool
) -> Act:
    person.note = "looking around"
    person.gaze = 0.2
    yield from person.react()
    yield from person.engage("left", "right")
    yield from walk_to(person, lambda sight: _goal(sight, ahead, aside), tolerance, by_rule=by_rule)
    person.note = "done"
    return True
