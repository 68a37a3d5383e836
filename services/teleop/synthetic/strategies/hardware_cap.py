"""hardware/cap: hold the can with one hand, grip its cap with the other and pull it off upwards."""

import numpy as np

from common.robot.pose import Pose
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight, easy_yaw, hand_pose

OFF = 0.06
"""The cap is off when it is seen this far above its seat [m]."""
CAN_HEIGHT = 0.15


def take_cap_off(person: Person) -> Act:
    """Take the cap off with two hands."""
    holder, puller = ("left", "right") if person.chance(0.5) else ("right", "left")
    person.note = "looking at the can"
    person.gaze = 0.75
    yield from person.react()
    yield from person.engage("left", "right")
    yield from grasp(person, holder, "can_grip", person.vary(0.0, 0.006))
    for _ in range(3):
        yield from grasp(person, puller, "cap_grip", person.vary(0.004, 0.003))
        yield from pull(person, puller, holder)
        if off(person.sight):
            break
        yield from person.grip(puller, 0.0)
    else:
        raise StrategyError("the cap did not come off in three attempts")
    person.note = "done"
    return True


def off(sight: Sight) -> bool:
    """Whether the cap is off the can."""
    can, cap = sight.thing("can"), sight.thing("cap")
    seat = can.apply(np.array([0.0, 0.0, CAN_HEIGHT]))
    return float(np.linalg.norm(cap.position - seat)) > OFF


def grasp(person: Person, side: str, thing: str, height: float) -> Act:
    """Open hand before the thing, around it, close."""
    # Both hands are turned inward to meet before the body, the one that reaches across more.
    aside = float(person.sight.in_body(person.sight.thing(thing)).position[1])
    yaw = easy_yaw(side, aside) + person.vary(0.0, 0.04)
    before = person.vary(0.10, 0.006)

    def at(sight: Sight, ahead: float) -> Pose:
        place = sight.torso.local(sight.thing(thing).position)
        along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        return Pose(
            place + ahead * along + np.array([0.0, 0.0, height]),
            hand_pose(0.0, 0.0, 0.0, 0.0, 0.0, yaw).quaternion,
        )

    person.note = f"{side} hand to the {thing.removesuffix('_grip')}"
    yield from person.together(
        person.grip(side, 0.0),
        person.reach(side, lambda s: at(s, -before), tolerance=0.015, angle=0.15),
    )
    yield from person.reach(side, lambda s: at(s, 0.0), speed=0.7, tolerance=0.012, angle=0.15)
    yield from person.react()
    yield from person.grip(side, 1.0)
    return True


def pull(person: Person, side: str, holder: str) -> Act:
    """Up, until the cap is seen to be off; the other hand keeps the can down."""
    person.note = "pulling the cap"
    speed = person.vary(0.08, 0.015)
    yield from person.together(
        person.push(
            side, lambda _: np.array([0.0, 0.0, 1.0]), 0.2, speed=speed, until=off, lead=0.14
        ),
        person.push(
            holder, lambda _: np.array([0.0, 0.0, -1.0]), 0.1, speed=speed, until=off, lead=0.08
        ),
    )
    return True
