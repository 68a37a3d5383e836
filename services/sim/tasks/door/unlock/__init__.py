"""Unlock the door."""

import numpy as np

from services.sim.scenes.door import LATCH_RATIO, LATCH_REACH
from services.sim.tasks.base import HAND, Stage, Start, Task, normal, pairs
from services.sim.tasks.door import JOINTS, OBJECTS, door_marks, hinge

AJAR = 0.043633
"""2.5 degrees [rad], as in the public simulation."""
PRESSED = LATCH_RATIO.value * LATCH_REACH.value
"""Lever angle at which the bolt is clear of the strike [rad]."""


def _start(rng: np.random.Generator) -> Start:
    return Start(normal(rng, 0.22, 0.01), normal(rng, 0.05, 0.02), normal(rng, 0.05, 0.07))


TASK = Task(
    name="door/unlock",
    scene="door",
    goal="Press the lever down and push the door ajar.",
    rule="leaf opened by 2.5°, and upright 1 s later; only the hands touch lever and leaf",
    limit=20.0,
    start=_start,
    stages=(
        Stage("lever pressed", lambda now: now.joints["door_lever"] > PRESSED, counts=True),
        Stage("door ajar", lambda now: hinge(now) > AJAR, counts=True),
        Stage("door unlocked", lambda now: not now.fallen, hold=1.0, after="door ajar"),
    ),
    desired=pairs((*HAND, "wrist"), "lever") | pairs(HAND, "leaf"),
    marks=door_marks(0.22, 0.05),
    objects=OBJECTS,
    joints=JOINTS,
    origin="start, rule and limit of the public TRILL simulation, which also calls it a success "
    "when the 20 s are over; here that is a failure",
)
