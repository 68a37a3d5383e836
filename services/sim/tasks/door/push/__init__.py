"""Push the unlocked door open and walk through."""

import numpy as np

from services.sim.tasks.base import HAND, Snapshot, Stage, Start, Task, normal, pairs
from services.sim.tasks.door import JOINTS, OBJECTS, door_marks, hinge

THROUGH = 1.2
"""Torso beyond this x has the whole robot behind the frame [m]."""
LANE = 0.35


def _start(rng: np.random.Generator) -> Start:
    x, y, yaw = normal(rng, 0.22, 0.01), normal(rng, 0.05, 0.02), normal(rng, 0.05, 0.07)
    return Start(x, y, yaw, {"door_hinge": (max(normal(rng, 0.1, 0.025), 0.08),)})


def _at_threshold(now: Snapshot) -> bool:
    x, y, _ = now.robot.position.tolist()
    return x > 0.5 and abs(y) < 0.3 and now.standing


def _through(now: Snapshot) -> bool:
    x, y, _ = now.robot.position.tolist()
    return x > THROUGH and abs(y) < LANE and now.standing


TASK = Task(
    name="door/push",
    scene="door",
    goal="Push the unlocked door open and walk through it.",
    rule="torso beyond x = 1.2 m with |y| < 0.35 m, standing on both feet for 0.5 s; only hands, "
    "wrists and forearms touch leaf and lever, nothing the frame",
    limit=70.0,
    start=_start,
    stages=(
        Stage("door half open", lambda now: hinge(now) > 0.785, counts=True),
        Stage("at the threshold", _at_threshold, hold=0.5, counts=True),
        Stage("through the door", _through, hold=0.5),
    ),
    desired=pairs((*HAND, "wrist", "forearm"), "leaf", "lever"),
    marks=door_marks(1.3, 0.0),
    objects=OBJECTS,
    joints=JOINTS,
    origin="start and limit of the public TRILL simulation; its rule (x > 0.5 m, |y| < 0.3 m) is "
    "the stage 'at the threshold', the goal is the prototype's: through the door",
)
