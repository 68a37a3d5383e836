"""Walk to the door."""

import math

import numpy as np

from services.sim.tasks.base import Snapshot, Stage, Start, Task, normal
from services.sim.tasks.door import JOINTS, OBJECTS, PUBLIC_GOAL, door_marks

GOAL_RADIUS = 0.1
GOAL_YAW = 0.3
NEAR = 0.3
CORRIDOR = 0.3
"""Beyond the goal it must still be in front of the door: |y| less than this [m]."""


def _start(rng: np.random.Generator) -> Start:
    return Start(normal(rng, -0.5, 0.1), normal(rng, 0.0, 0.2), normal(rng, 0.0, 0.2))


def _distance(snapshot: Snapshot) -> float:
    x, y, _ = snapshot.robot.position.tolist()
    return math.hypot(x - PUBLIC_GOAL[0], y - PUBLIC_GOAL[1])


def _there(snapshot: Snapshot) -> bool:
    x, y, _ = snapshot.robot.position.tolist()
    past = x > PUBLIC_GOAL[0] and abs(y) < CORRIDOR
    near = past or _distance(snapshot) < GOAL_RADIUS
    return near and abs(snapshot.robot.yaw) < GOAL_YAW and snapshot.standing


TASK = Task(
    name="door/walk",
    scene="door",
    goal="Walk to the door and stand before it, facing it.",
    rule="torso within 0.1 m of (0.1, 0) or past it with |y| < 0.3 m, |yaw| < 0.3 rad, standing "
    "on both feet for 0.5 s; nothing touched",
    limit=70.0,
    start=_start,
    stages=(
        Stage("near the door", lambda now: _distance(now) < NEAR, counts=True),
        Stage("standing before the door", _there, hold=0.5),
    ),
    marks=door_marks(*PUBLIC_GOAL),
    objects=OBJECTS,
    joints=JOINTS,
    origin="start, rule and limit of the public TRILL simulation; |y| < 0.3 m past the goal is new",
)
