"""hardware/tool: grip the tool, lift it, bring it over the box, put it down and let go."""

import numpy as np

from common.robot.pose import Pose
from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight, easy_yaw, hand_pose

SIDE = "right"
SOLE = 0.02
"""How far above the box's underside the tool is let go [m]."""


def tool_into_box(person: Person) -> Act:
    """Bring the tool into the box, reaching across or side-stepping."""
    person.note = "looking at the tool"
    person.gaze = 0.75
    yield from person.react()
    yield from person.engage("left", "right")
    for _ in range(3):
        yield from take(person)
        if held(person.sight):
            break
    else:
        raise StrategyError("the tool was not lifted in three attempts")
    if person.chance(0.4):
        yield from side_step(person)
    yield from put_into_box(person)
    person.note = "done"
    return True


def held(sight: Sight) -> bool:
    """Whether the tool is in the hand, off the table."""
    grip = sight.thing("tool_grip").position
    near = float(np.linalg.norm(grip - sight.hand_in_world(SIDE))) < 0.05
    return near and float(grip[2] - sight.thing("goal").position[2]) > 0.12


def pointing(sight: Sight, point: Array, yaw: float) -> Pose:
    """The level hand at a point (3,) of the world with a heading in the body frame."""
    return Pose(sight.torso.local(point), hand_pose(0.0, 0.0, 0.0, 0.0, 0.0, yaw).quaternion)


def take(person: Person) -> Act:
    """Open hand before the handle, around it, close and lift."""
    before, height = person.vary(0.13, 0.01), person.vary(0.0, 0.006)
    lift, pitch = person.vary(0.12, 0.008), person.vary(0.15, 0.03)

    def at(sight: Sight, ahead: float) -> Pose:
        place = sight.torso.local(sight.thing("tool_grip").position)
        yaw = easy_yaw(SIDE, float(place[1]))
        along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        place = place + (ahead - 0.01) * along + np.array([0.0, 0.0, height])
        return Pose(place, hand_pose(0.0, 0.0, 0.0, 0.0, pitch, yaw).quaternion)

    person.note = "to the tool"
    yield from person.together(
        person.grip(SIDE, 0.0),
        person.reach(SIDE, lambda s: at(s, -before), tolerance=0.015, angle=0.12),
    )
    yield from person.reach(SIDE, lambda s: at(s, 0.0), speed=0.8, tolerance=0.012, angle=0.12)
    person.note = "gripping"
    yield from person.react()
    yield from person.grip(SIDE, 1.0)
    person.note = "lifting"
    here = person.sight.hand_in_world(SIDE) + np.array([0.0, 0.0, lift])
    turned = person.sight.hands[SIDE].quaternion
    yield from person.reach(
        SIDE, lambda s: Pose(s.torso.local(here), turned), speed=0.7, tolerance=0.025
    )
    return True


def side_step(person: Person) -> Act:
    """Carry the tool close and side-step until the box is before the hand."""
    person.note = "carrying"
    hold = person.sight.hands[SIDE]
    close = Pose(np.array([0.36, -0.24, hold.position[2]]), hold.quaternion)
    yield from person.reach(SIDE, lambda _: close, speed=0.8, tolerance=0.03)
    for _ in range(3):
        box = person.sight.in_body(person.sight.thing("box"))
        if float(box.position[1]) < -0.15:
            break
        yield from person.gait(Gait.SIDE_LEFT)
        yield from person.react()
    return True


def put_into_box(person: Person) -> Act:
    """Over the box, down, let go, and straight back."""
    aside, ahead = person.vary(0.0, 0.006), person.vary(0.0, 0.01)

    def over(sight: Sight, height: float) -> Pose:
        box, tool = sight.thing("box"), sight.thing("tool")
        grip = sight.hand_in_world(SIDE) - tool.position
        point = box.position + grip + np.array([ahead, aside, height])
        yaw = easy_yaw(SIDE, float(sight.torso.local(point)[1]))
        return pointing(sight, point, yaw)

    person.note = "over the box"
    for corrections in (0, 2):
        # Turning the hand swings the tool: look again from where it has come to.
        yield from person.reach(
            SIDE, lambda s: over(s, 0.115), speed=0.8, tolerance=0.02, corrections=corrections
        )
    person.note = "putting down"
    yield from person.reach(SIDE, lambda s: over(s, SOLE), speed=0.6, tolerance=0.015)
    yield from person.react()
    yield from person.grip(SIDE, 0.0)
    person.note = "drawing back"
    yaw = easy_yaw(SIDE, float(person.sight.hands[SIDE].position[1]))
    here = person.sight.hands[SIDE]
    back = here.position - 0.15 * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    yield from person.reach(
        SIDE, lambda _: Pose(back, here.quaternion), speed=0.8, tolerance=0.05, corrections=0
    )
    return True
