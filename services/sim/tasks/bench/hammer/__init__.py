"""Take the hammer off its hanger and put it on the trolley."""

import math

import numpy as np

from services.sim.scenes.bench import HAMMER_JOINT, HAMMER_REST, HANGER
from services.sim.scenes.cart import TRAY_HALF, TRAY_HEIGHT
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
from services.sim.tasks.bench import JOINTS, cart_at

CART_PLACE = (0.68, -0.72)
"""The trolley's centre (x, y) [m]; its bar is on the far side."""
REST_SPEED = 0.05
STANDING = 0.32
"""A hammer that stands on its handle has its head this high above the tray [m]."""


def _start(rng: np.random.Generator) -> Start:
    hammer = (spread(rng, HANGER[0], 0.01), spread(rng, HANGER[1], 0.01))
    cart = (spread(rng, CART_PLACE[0], 0.01), spread(rng, CART_PLACE[1], 0.01))
    return Start(
        spread(rng, 0.0, 0.015),
        spread(rng, 0.0, 0.02),
        spread(rng, 0.0, 0.05),
        {
            HAMMER_JOINT: free_joint(*hammer, HAMMER_REST),
            **cart_at(*cart, math.pi + spread(rng, 0.0, 0.02)),
        },
    )


def _lifted(now: Snapshot) -> bool:
    return not now.touched("hanger", "hammer") and now.touched("hammer", *HAND)


def _on_tray(now: Snapshot) -> bool:
    x, y, z = now.objects["cart"].local(now.objects["hammer"].position).tolist()
    inside = abs(x) < TRAY_HALF and abs(y) < TRAY_HALF and TRAY_HEIGHT < z < TRAY_HEIGHT + STANDING
    return inside and now.touched("hammer", "cart tray")


def _at_rest(now: Snapshot) -> bool:
    return _on_tray(now) and not now.touched("hammer") and now.objects["hammer"].speed < REST_SPEED


TASK = Task(
    name="bench/hammer",
    scene="bench",
    goal="Take the hammer off the hanger and put it onto the trolley's tray.",
    rule="hammer at rest within the tray's rim and let go for 1 s, robot upright; only the hands "
    "touch the hammer, nothing else is touched",
    limit=60.0,
    start=_start,
    stages=(
        Stage("hammer grasped", lambda now: now.touched("hammer", "finger"), hold=0.2),
        Stage("hammer off the hanger", _lifted, hold=0.2, counts=True),
        Stage("hammer on the tray", _on_tray, counts=True, after="hammer off the hanger"),
        Stage("hammer put down", _at_rest, hold=1.0, after="hammer on the tray"),
    ),
    wrongs=(Wrong("the hammer fell to the floor", lambda now: now.touched("floor", "hammer")),),
    desired=pairs(HAND, "hammer"),
    marks={"goal": flat_pose(*CART_PLACE, TRAY_HEIGHT)},
    objects=("hammer", "hammer_grip", "cart", "cart_tray"),
    joints=JOINTS,
    origin="never published; places and spread of the prototype (11 of 12)",
)
