"""Push the trolley to its goal."""

import math

import numpy as np

from services.sim.tasks.base import (
    HAND,
    Snapshot,
    Stage,
    Start,
    Task,
    Wrong,
    flat_pose,
    pairs,
    spread,
)
from services.sim.tasks.bench import JOINTS, PUSH_GOAL, PUSH_LANE, PUSH_START, cart_at, turn

SHORT, BEYOND = 0.10, 0.25
"""How far before and behind the goal the trolley may stop [m]."""
ASIDE = 0.15
TURNED = math.radians(15.0)
REST_SPEED = 0.02


def _start(rng: np.random.Generator) -> Start:
    cart = cart_at(spread(rng, PUSH_START[0], 0.015), spread(rng, PUSH_START[1], 0.02), 0.0)
    return Start(
        spread(rng, 0.0, 0.015), spread(rng, PUSH_LANE, 0.02), spread(rng, 0.0, 0.05), cart
    )


def _offset(now: Snapshot) -> tuple[float, float, float]:
    """The trolley's place and heading from the goal [m, m, rad]."""
    x, y, yaw = (now.joints[name] for name in JOINTS)
    return x - PUSH_GOAL[0], y - PUSH_GOAL[1], turn(yaw)


def _at_goal(now: Snapshot) -> bool:
    x, y, yaw = _offset(now)
    placed = -SHORT <= x <= BEYOND and abs(y) < ASIDE and abs(yaw) < TURNED
    return placed and now.objects["cart"].speed < REST_SPEED


def _lost(now: Snapshot) -> bool:
    x, y, yaw = _offset(now)
    return x > BEYOND + 0.1 or abs(y) > 2.0 * ASIDE or abs(yaw) > 2.0 * TURNED


def _both_hands(now: Snapshot) -> bool:
    return all(now.touched("cart bar", *HAND, side=side) for side in ("left", "right"))


TASK = Task(
    name="bench/push",
    scene="bench",
    goal="Push the heavy trolley straight ahead into the marked place, 1 m on.",
    rule="trolley at rest for 0.5 s, 0.10 m short to 0.25 m beyond the goal, within 0.15 m of the "
    "lane and 15° of its heading; only hands and wrists touch the push bar, nothing the trolley",
    limit=60.0,
    start=_start,
    stages=(
        Stage("both hands on the bar", _both_hands),
        Stage("half way", lambda now: _offset(now)[0] > -0.5, counts=True),
        Stage("trolley at its place", _at_goal, hold=0.5),
    ),
    wrongs=(Wrong("the trolley left its lane", _lost, hold=0.2),),
    desired=pairs((*HAND, "wrist"), "cart bar"),
    marks={"goal": flat_pose(*PUSH_GOAL)},
    objects=("cart", "cart_bar"),
    joints=JOINTS,
    origin="never published; distance, tolerance and spread of the prototype (8 of 8)",
)
