"""bench/hammer: grip the hammer, lift it off, side-step to the trolley and lay it down."""

import numpy as np

from common.robot.pose import Pose
from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight, hand_pose

SIDE = "right"
BELOW_GRIP = 0.1325
"""From the gripped point down to the end of the handle [m]."""
LIFTED = 0.03
FURTHEST = 0.49
"""Before the body no hand reaches further [m]."""
TRAY_X = 0.13
"""Where to put the hammer: this far behind the tray's near rim [m]."""


def hammer(person: Person) -> Act:
    """Bring the hammer to the tray."""
    person.note = "looking at the hammer"
    person.gaze = 0.3
    yield from person.react()
    yield from person.engage("left", "right")
    for _ in range(3):
        yield from take(person)
        if lifted(person.sight):
            break
    else:
        raise StrategyError("the hammer did not come off the hanger in three attempts")
    yield from carry(person)
    yield from put_down(person)
    person.note = "done"
    return True


def lifted(sight: Sight) -> bool:
    """Whether the hammer is in the hand."""
    off = sight.thing("hammer_grip").position - sight.hand_in_world(SIDE)
    return float(np.linalg.norm(off)) < 0.05


def facing(sight: Sight, point: Array, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    """The hand at a point (3,) of the world, pointing along world x, in the body frame."""
    yaw = -sight.torso.yaw
    return Pose(sight.torso.local(point), hand_pose(0.0, 0.0, 0.0, roll, pitch, yaw).quaternion)


def take(person: Person) -> Act:
    """Open hand before the handle, around it, close, lift, and back."""
    before = person.vary(0.16, 0.015)
    height = person.vary(0.0, 0.008)
    lift, back = person.vary(0.045, 0.004), person.vary(0.13, 0.01)

    def at(ahead: float, up: float) -> Pose:
        grip = person.sight.thing("hammer_grip").position
        return facing(person.sight, grip + np.array([ahead, 0.0, height + up]))

    person.note = "to the hammer"
    yield from person.together(
        person.grip(SIDE, 0.0),
        person.reach(SIDE, lambda _: at(-before, 0.0), tolerance=0.015, angle=0.12),
    )
    yield from person.reach(SIDE, lambda _: at(0.0, 0.0), speed=0.8, tolerance=0.012, angle=0.12)
    person.note = "gripping"
    yield from person.react()
    yield from person.grip(SIDE, 1.0)
    yield from person.pause(abs(person.vary(0.15, 0.1)))
    person.note = "lifting"
    yield from shift(person, (0.0, 0.0, lift), 0.7)
    yield from shift(person, (-back, 0.0, 0.0), 0.8)
    return True


def shift(person: Person, by: tuple[float, float, float], speed: float = 1.0) -> Act:
    """Move the hand along the world's axes from where it is seen."""
    here = person.sight.hand_in_world(SIDE) + np.array(by)
    held = person.sight.hands[SIDE].quaternion
    yield from person.reach(
        SIDE,
        lambda sight: Pose(sight.torso.local(here), held),
        speed=speed,
        tolerance=0.025,
        corrections=2,
    )
    return True


def carry(person: Person) -> Act:
    """Low before the body, clear of the hanger while the torso sways, and side-step to the tray."""
    x, y, z = person.vary(0.305, 0.006), person.vary(-0.22, 0.008), person.vary(0.04, 0.005)
    person.note = "carrying"
    yield from person.reach(SIDE, lambda _: hand_pose(x, y, z), tolerance=0.025)
    steps = 0
    while steps < 9:
        torso, tray = person.sight.torso, person.sight.thing("cart_tray")
        aside = torso.position[1] + y - tray.position[1]
        if aside < 0.07:
            break
        yield from person.gait(Gait.SIDE_RIGHT)
        yield from person.react()
        steps += 1
    high = hand_pose(person.vary(0.335, 0.006), y, person.vary(0.12, 0.004))
    yield from person.reach(SIDE, lambda _: high, tolerance=0.025)
    return True


def put_down(person: Person) -> Act:
    """Over the tray, lean the hammer away, lower, open, back."""
    tray = person.sight.thing("cart_tray").position
    inside, lean = person.vary(TRAY_X, 0.01), person.vary(0.45, 0.05)
    near = tray[0] - 0.28 + inside

    def over(sight: Sight, height: float, pitch: float) -> Pose:
        y = float(np.clip(sight.hand_in_world(SIDE)[1], tray[1] - 0.14, tray[1] + 0.14))
        pose = facing(sight, np.array([near, y, tray[2] + height]), pitch)
        return Pose(np.minimum(pose.position, (FURTHEST, np.inf, np.inf)), pose.quaternion)

    person.note = "putting down"
    yield from person.reach(
        SIDE, lambda s: over(s, BELOW_GRIP + 0.075, 0.0), speed=0.9, tolerance=0.025
    )
    yield from person.reach(
        SIDE, lambda s: over(s, BELOW_GRIP + 0.03, lean), speed=0.7, tolerance=0.025, angle=0.2
    )
    yield from person.react()
    yield from person.grip(SIDE, 0.0)
    person.note = "drawing back"
    yield from shift(person, (-0.18, 0.0, 0.03), 0.9)
    return True
