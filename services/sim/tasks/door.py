"""The Door environment: walk to the door, unlock it, push it open and walk through."""

import math

from common.robot.pose import Pose
from services.sim.scenes.door import LATCH_RATIO, LATCH_REACH
from services.sim.tasks.base import (
    HAND,
    Draw,
    Snapshot,
    Stage,
    Start,
    Task,
    contact_pairs,
)

OBJECTS = ("leaf", "lever", "lever_grip")
JOINTS = ("door_hinge", "door_lever", "door_latch")
PUBLIC_GOAL = (0.1, 0.0)
"""Goal before the door in the public TRILL simulation (x, y) [m]."""


def door_marks(x: float, y: float) -> dict[str, Pose]:
    """Return the mark of the goal of the torso's ground point."""
    return {"goal": Pose.upright(x, y)}


def hinge(snapshot: Snapshot) -> float:
    """Return the opening angle of the leaf [rad]."""
    return snapshot.joints["door_hinge"]


WALK_GOAL_RADIUS = 0.1
WALK_GOAL_YAW = 0.3
WALK_NEAR = 0.3
WALK_CORRIDOR = 0.3
"""Largest |y| beyond the goal, so that the robot is still in front of the door [m]."""


def _walk_start(draw: Draw) -> Start:
    return Start(draw.normal(-0.5, 0.1), draw.normal(0.0, 0.2), draw.normal(0.0, 0.2))


def _walk_distance(snapshot: Snapshot) -> float:
    x, y, _ = snapshot.robot.position.tolist()
    return math.hypot(x - PUBLIC_GOAL[0], y - PUBLIC_GOAL[1])


def _walk_there(snapshot: Snapshot) -> bool:
    x, y, _ = snapshot.robot.position.tolist()
    past = x > PUBLIC_GOAL[0] and abs(y) < WALK_CORRIDOR
    near = past or _walk_distance(snapshot) < WALK_GOAL_RADIUS
    return near and abs(snapshot.robot.yaw) < WALK_GOAL_YAW and snapshot.standing


WALK = Task(
    name="door/walk",
    scene="door",
    goal="Walk to the door and stand before it, facing it.",
    rule="torso within 0.1 m of (0.1, 0) or past it with |y| < 0.3 m, |yaw| < 0.3 rad, standing "
    "on both feet for 0.5 s; nothing touched",
    limit=70.0,
    start=_walk_start,
    stages=(
        Stage("near the door", lambda now: _walk_distance(now) < WALK_NEAR, partial=True),
        Stage("standing before the door", _walk_there, hold=0.5),
    ),
    marks=door_marks(*PUBLIC_GOAL),
    objects=OBJECTS,
    joints=JOINTS,
    origin="start, rule and limit of the public TRILL simulation; |y| < 0.3 m past the goal is new",
)


UNLOCK_AJAR = 0.043633
"""2.5 degrees [rad], as in the public simulation."""
UNLOCK_PRESSED = LATCH_RATIO.value * LATCH_REACH.value
"""Lever angle at which the bolt is clear of the strike [rad]."""


def _unlock_start(draw: Draw) -> Start:
    return Start(draw.normal(0.22, 0.01), draw.normal(0.05, 0.02), draw.normal(0.05, 0.07))


UNLOCK = Task(
    name="door/unlock",
    scene="door",
    goal="Press the lever down and push the door ajar.",
    rule="leaf opened by 2.5°, and upright 1 s later; only the hands touch lever and leaf",
    limit=20.0,
    start=_unlock_start,
    stages=(
        Stage("lever pressed", lambda now: now.joints["door_lever"] > UNLOCK_PRESSED, partial=True),
        Stage("door ajar", lambda now: hinge(now) > UNLOCK_AJAR, partial=True),
        Stage("door unlocked", lambda now: not now.fallen, hold=1.0, after="door ajar"),
    ),
    desired=contact_pairs((*HAND, "wrist"), "lever") | contact_pairs(HAND, "leaf"),
    marks=door_marks(0.22, 0.05),
    objects=OBJECTS,
    joints=JOINTS,
    origin="start, rule and limit of the public TRILL simulation, which also calls it a success "
    "when the 20 s are over; here that is a failure",
)


PUSH_THROUGH = 1.2
"""Torso x beyond which the whole robot is behind the frame [m]."""
PUSH_LANE = 0.35


def _push_start(draw: Draw) -> Start:
    x, y, yaw = draw.normal(0.22, 0.01), draw.normal(0.05, 0.02), draw.normal(0.05, 0.07)
    return Start(x, y, yaw, {"door_hinge": (max(draw.normal(0.1, 0.025), 0.08),)})


def _push_at_threshold(now: Snapshot) -> bool:
    x, y, _ = now.robot.position.tolist()
    return x > 0.5 and abs(y) < 0.3 and now.standing


def _push_through(now: Snapshot) -> bool:
    x, y, _ = now.robot.position.tolist()
    return x > PUSH_THROUGH and abs(y) < PUSH_LANE and now.standing


PUSH = Task(
    name="door/push",
    scene="door",
    goal="Push the unlocked door open and walk through it.",
    rule="torso beyond x = 1.2 m with |y| < 0.35 m, standing on both feet for 0.5 s; only hands, "
    "wrists and forearms touch leaf and lever, nothing the frame",
    limit=70.0,
    start=_push_start,
    stages=(
        Stage("door half open", lambda now: hinge(now) > 0.785, partial=True),
        Stage("at the threshold", _push_at_threshold, hold=0.5, partial=True),
        Stage("through the door", _push_through, hold=0.5),
    ),
    desired=contact_pairs((*HAND, "wrist", "forearm"), "leaf", "lever"),
    marks=door_marks(1.3, 0.0),
    objects=OBJECTS,
    joints=JOINTS,
    origin="start and limit of the public TRILL simulation; its rule (x > 0.5 m, |y| < 0.3 m) is "
    "the stage 'at the threshold', the goal is the prototype's: through the door",
)

TASKS = (WALK, UNLOCK, PUSH)
