"""door/push: open the leaf with the left fist, keep it open with the right, and walk through."""

import math

from common.schemas import Gait
from services.teleop.synthetic.person import Act, Person, StrategyError
from services.teleop.synthetic.sight import Sight, hand_pose

BEYOND = 1.27
"""The torso must get further than this in world x [m]."""
LANE = 0.035
"""Best y to go through at [m]; the leaf is on the right, the strike nearer on the left."""
TOO_LEFT, TOO_RIGHT = 0.04, -0.065
"""Beside the lane [m]; further apart than a side-step, so that none is taken back."""
MOST_GAITS = 12


def push_through(person: Person) -> Act:
    """Open the door and walk through."""
    person.note = "looking at the door"
    person.gaze = 0.15
    yield from person.react()
    yield from person.engage("left", "right")
    yield from person.together(person.grip("left", 1.0), person.grip("right", 1.0))
    yield from left_to_leaf(person)
    lane = person.vary(LANE, 0.005)
    right_out = parked = False
    for _ in range(MOST_GAITS):
        sight = person.sight
        if sight.torso.position[0] > BEYOND:
            break
        opened = sight.joints["door_hinge"]
        if not right_out and opened > math.radians(13.0) and sight.torso.position[0] > 0.35:
            yield from right_to_leaf(person)
            right_out = True
        if right_out and not parked:
            yield from park_left(person)
            parked = True
        gait = next_gait(person.sight, lane)
        person.note = f"{gait.name.lower().replace('_', ' ')}, leaf {math.degrees(opened):.0f} deg"
        yield from person.gait(gait)
        yield from person.react()
    else:
        raise StrategyError(f"not through the door after {MOST_GAITS} gaits")
    person.note = "done"
    return True


def next_gait(sight: Sight, lane: float) -> Gait:
    """Ahead, but for straightening up and keeping to the lane before the frame is reached."""
    x, y, _ = sight.torso.position.tolist()
    yaw = sight.torso.yaw
    if abs(yaw) > math.radians(9.5):
        return Gait.TURN_RIGHT if yaw > 0.0 else Gait.TURN_LEFT
    drift = y + yaw * max(0.0, 0.7 - x) - lane
    if not TOO_RIGHT < drift < TOO_LEFT and x < 0.9:
        return Gait.SIDE_RIGHT if drift > 0.0 else Gait.SIDE_LEFT
    return Gait.FORWARD


def left_to_leaf(person: Person) -> Act:
    """The left fist low, below the lever, and out to the leaf."""
    person.note = "left fist to the leaf"
    y = person.vary(0.11, 0.01)
    low = hand_pose(0.28, y + 0.02, person.vary(-0.03, 0.008), 0.0, 0.0, -0.26)
    out = hand_pose(person.vary(0.42, 0.008), y, person.vary(-0.01, 0.008), 0.0, 0.0, -0.26)
    yield from person.reach("left", lambda _: low, tolerance=0.03, angle=0.3, corrections=1)
    yield from person.reach("left", lambda _: out, tolerance=0.03, angle=0.3, corrections=1)
    return True


def right_to_leaf(person: Person) -> Act:
    """The right fist out to the right, where it keeps the leaf off the body."""
    person.note = "right fist to the leaf"
    x, y = person.vary(0.40, 0.008), person.vary(-0.40, 0.008)
    pose = hand_pose(x, y, person.vary(0.06, 0.01), 0.0, 0.0, -0.6)
    yield from person.reach(
        "right", lambda _: pose, speed=0.8, tolerance=0.05, angle=0.4, corrections=1
    )
    return True


def park_left(person: Person) -> Act:
    """The left hand close to the body, away from the jamb."""
    person.note = "left hand in"
    pose = hand_pose(person.vary(0.26, 0.008), 0.16, -0.05, 0.0, 0.0, -0.1)
    yield from person.reach("left", lambda _: pose, tolerance=0.05, angle=0.4, corrections=0)
    return True
