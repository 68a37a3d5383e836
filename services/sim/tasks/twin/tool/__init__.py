"""Pick the tool up and put it into the box."""

import numpy as np

from services.sim.scenes.furniture import TABLE_TOP
from services.sim.scenes.tool import (
    BOX_HALF,
    BOX_HEIGHT,
    BOX_JOINT,
    BOX_PLACE,
    TOOL_JOINT,
    TOOL_PLACE,
)
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

REST_SPEED = 0.05


def _start(rng: np.random.Generator) -> Start:
    tool = (spread(rng, TOOL_PLACE[0], 0.01), spread(rng, TOOL_PLACE[1], 0.015))
    box = (spread(rng, BOX_PLACE[0], 0.01), spread(rng, BOX_PLACE[1], 0.01))
    return Start(
        spread(rng, 0.0, 0.015),
        spread(rng, 0.0, 0.02),
        spread(rng, 0.0, 0.05),
        {
            TOOL_JOINT: free_joint(*tool, TABLE_TOP, spread(rng, 0.0, 0.2)),
            BOX_JOINT: free_joint(*box, TABLE_TOP, spread(rng, 0.0, 0.05)),
        },
    )


def _lifted(now: Snapshot) -> bool:
    return not now.touched("table", "tool") and now.touched("tool", *HAND)


def _inside(now: Snapshot) -> bool:
    """The handle's foot is between the walls, and the tool rests on the box alone."""
    x, y, z = now.objects["box"].local(now.objects["tool"].position).tolist()
    placed = abs(x) < BOX_HALF[0] and abs(y) < BOX_HALF[1] and z < BOX_HEIGHT
    return placed and now.touched("tool", "box") and not now.touched("tool", "table")


def _at_rest(now: Snapshot) -> bool:
    return _inside(now) and not now.touched("tool") and now.objects["tool"].speed < REST_SPEED


def _fell(now: Snapshot) -> bool:
    return now.touched("floor", "tool", "box")


TASK = Task(
    name="twin/tool",
    scene="tool",
    goal="Pick the tool up from the table and put it into the box.",
    rule="tool at rest inside the box and let go for 1 s, robot upright; only the hands touch the "
    "tool, nothing else is touched",
    limit=60.0,
    start=_start,
    stages=(
        Stage("tool grasped", lambda now: now.touched("tool", "finger"), hold=0.2),
        Stage("tool lifted", _lifted, hold=0.2, counts=True),
        Stage("tool in the box", _inside, after="tool lifted", counts=True),
        Stage("tool put down", _at_rest, hold=1.0, after="tool in the box"),
    ),
    wrongs=(Wrong("tool or box fell to the floor", _fell),),
    desired=pairs(HAND, "tool"),
    marks={"goal": flat_pose(*BOX_PLACE, TABLE_TOP)},
    objects=("tool", "tool_grip", "box"),
    noise=NOISE,
    link=LINK,
    origin="twin of the paper's hardware task; numbers never published, places by the reach of the "
    "right hand",
)
