"""Hold the spray can with one hand and take its cap off with the other."""

import numpy as np

from services.sim.scenes.cap import CAN_HEIGHT, CAN_JOINT, CAN_PLACE, CAN_REST, CAP_JOINT
from services.sim.tasks.base import (
    HAND,
    Snapshot,
    Stage,
    Start,
    Task,
    Wrong,
    flat_pose,
    free_joint,
    pairs,
    spread,
)
from services.sim.tasks.twin import LINK, NOISE

OFF = 0.035
"""The cap's edge is this far from the can's shoulder: past the end of the neck [m]."""


def _start(rng: np.random.Generator) -> Start:
    x, y = spread(rng, CAN_PLACE[0], 0.01), spread(rng, CAN_PLACE[1], 0.01)
    return Start(
        spread(rng, 0.0, 0.015),
        spread(rng, 0.0, 0.02),
        spread(rng, 0.0, 0.05),
        {
            CAN_JOINT: free_joint(x, y, CAN_REST),
            CAP_JOINT: free_joint(x, y, CAN_REST + CAN_HEIGHT),
        },
    )


def _off(now: Snapshot) -> bool:
    seat = np.array([0.0, 0.0, CAN_HEIGHT])
    edge = now.objects["can"].local(now.objects["cap"].position)
    return float(np.linalg.norm(edge - seat)) > OFF


def _can_held(now: Snapshot) -> bool:
    return now.touched("can", *HAND)


def _two_hands(now: Snapshot) -> bool:
    return any(
        now.touched("can", *HAND, side=one) and now.touched("cap", *HAND, side=other)
        for one, other in (("left", "right"), ("right", "left"))
    )


TASK = Task(
    name="twin/cap",
    scene="cap",
    goal="Hold the spray can with one hand and take its cap off with the other.",
    rule="cap off the can for 0.5 s while one hand holds the can and the other the cap, robot "
    "upright; only the hands touch can and cap, nothing else is touched",
    limit=60.0,
    start=_start,
    stages=(
        Stage("can held", _can_held, hold=0.2),
        Stage("both hands at work", _two_hands, hold=0.2),
        Stage("cap off", _off, hold=0.2, counts=True),
        Stage(
            "cap taken off with two hands",
            lambda now: _off(now) and _two_hands(now),
            hold=0.5,
            after="both hands at work",
        ),
    ),
    wrongs=(Wrong("the can fell to the floor", lambda now: now.touched("floor", "can")),),
    desired=pairs(HAND, "can", "cap"),
    marks={"goal": flat_pose(*CAN_PLACE, CAN_REST)},
    objects=("can", "can_grip", "cap", "cap_grip"),
    noise=NOISE,
    link=LINK,
    origin="twin of the paper's hardware task; numbers never published, places by the reach of "
    "both hands turned inward by 30°",
)
