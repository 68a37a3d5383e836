"""Simulated counterparts of the paper's hardware tasks: noisy state, and its robot's link."""

import numpy as np

from common.robot.pose import Pose
from services.sim.config import TYPICAL_NOISE
from services.sim.scenes.cap import CAN_HEIGHT, CAN_JOINT, CAN_PLACE, CAN_REST, CAP_JOINT
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
    Draw,
    FailureCondition,
    Snapshot,
    Stage,
    Start,
    Task,
    contact_pairs,
    free_joint,
)

NOISE = TYPICAL_NOISE
LINK = "paper"
"""Preset of the delay between operator and robot."""


TOOL_REST_SPEED = 0.05


def _tool_start(draw: Draw) -> Start:
    tool = (draw.uniform(TOOL_PLACE[0], 0.01), draw.uniform(TOOL_PLACE[1], 0.015))
    box = (draw.uniform(BOX_PLACE[0], 0.01), draw.uniform(BOX_PLACE[1], 0.01))
    return Start(
        draw.uniform(0.0, 0.015),
        draw.uniform(0.0, 0.02),
        draw.uniform(0.0, 0.05),
        {
            TOOL_JOINT: free_joint(*tool, TABLE_TOP, draw.uniform(0.0, 0.2)),
            BOX_JOINT: free_joint(*box, TABLE_TOP, draw.uniform(0.0, 0.05)),
        },
    )


def _tool_lifted(now: Snapshot) -> bool:
    return not now.touched("table", "tool") and now.touched("tool", *HAND)


def _tool_inside(now: Snapshot) -> bool:
    """Return whether the tool is between the walls and rests on the box alone."""
    x, y, z = now.objects["box"].local(now.objects["tool"].position).tolist()
    placed = abs(x) < BOX_HALF[0] and abs(y) < BOX_HALF[1] and z < BOX_HEIGHT
    return placed and now.touched("tool", "box") and not now.touched("tool", "table")


def _tool_at_rest(now: Snapshot) -> bool:
    return (
        _tool_inside(now)
        and not now.touched("tool")
        and now.objects["tool"].speed < TOOL_REST_SPEED
    )


def _tool_fell(now: Snapshot) -> bool:
    return now.touched("floor", "tool", "box")


TOOL = Task(
    name="hardware/tool",
    scene="tool",
    goal="Pick the tool up from the table and put it into the box.",
    rule="tool at rest inside the box and let go for 1 s, robot upright; only the hands touch the "
    "tool, nothing else is touched",
    limit=60.0,
    start=_tool_start,
    stages=(
        Stage("tool grasped", lambda now: now.touched("tool", "finger"), hold=0.2),
        Stage("tool lifted", _tool_lifted, hold=0.2, partial=True),
        Stage("tool in the box", _tool_inside, after="tool lifted", partial=True),
        Stage("tool put down", _tool_at_rest, hold=1.0, after="tool in the box"),
    ),
    failures=(FailureCondition("tool or box fell to the floor", _tool_fell),),
    desired=contact_pairs(HAND, "tool"),
    marks={"goal": Pose.upright(*BOX_PLACE, TABLE_TOP)},
    objects=("tool", "tool_grip", "box"),
    noise=NOISE,
    link=LINK,
    origin="replica of the paper's hardware task; numbers never published, places by the reach of "
    "the right hand",
)


CAP_OFF = 0.035
"""Distance of the cap's edge from the can's shoulder, past the end of the neck [m]."""


def _cap_start(draw: Draw) -> Start:
    x, y = draw.uniform(CAN_PLACE[0], 0.01), draw.uniform(CAN_PLACE[1], 0.01)
    return Start(
        draw.uniform(0.0, 0.015),
        draw.uniform(0.0, 0.02),
        draw.uniform(0.0, 0.05),
        {
            CAN_JOINT: free_joint(x, y, CAN_REST),
            CAP_JOINT: free_joint(x, y, CAN_REST + CAN_HEIGHT),
        },
    )


def _cap_off(now: Snapshot) -> bool:
    seat = np.array([0.0, 0.0, CAN_HEIGHT])
    edge = now.objects["can"].local(now.objects["cap"].position)
    return float(np.linalg.norm(edge - seat)) > CAP_OFF


def _cap_can_held(now: Snapshot) -> bool:
    return now.touched("can", *HAND)


def _cap_two_hands(now: Snapshot) -> bool:
    return any(
        now.touched("can", *HAND, side=one) and now.touched("cap", *HAND, side=other)
        for one, other in (("left", "right"), ("right", "left"))
    )


CAP = Task(
    name="hardware/cap",
    scene="cap",
    goal="Hold the spray can with one hand and take its cap off with the other.",
    rule="cap off the can for 0.5 s while one hand holds the can and the other the cap, robot "
    "upright; only the hands touch can and cap, nothing else is touched",
    limit=60.0,
    start=_cap_start,
    stages=(
        Stage("can held", _cap_can_held, hold=0.2),
        Stage("both hands at work", _cap_two_hands, hold=0.2),
        Stage("cap off", _cap_off, hold=0.2, partial=True),
        Stage(
            "cap taken off with two hands",
            lambda now: _cap_off(now) and _cap_two_hands(now),
            hold=0.5,
            after="both hands at work",
        ),
    ),
    failures=(
        FailureCondition("the can fell to the floor", lambda now: now.touched("floor", "can")),
    ),
    desired=contact_pairs(HAND, "can", "cap"),
    marks={"goal": Pose.upright(*CAN_PLACE, CAN_REST)},
    objects=("can", "can_grip", "cap", "cap_grip"),
    noise=NOISE,
    link=LINK,
    origin="replica of the paper's hardware task; numbers never published, places by the reach of "
    "both hands turned inward by 30°",
)

TASKS = (TOOL, CAP)
