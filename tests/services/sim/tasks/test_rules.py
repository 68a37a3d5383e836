"""Each task's rule on made-up snapshots: met, and missed by a little."""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest

from common.schemas import TaskVerdict
from services.sim.scenes.bench import PUSH_GOAL, PUSH_LANE
from services.sim.scenes.cap import CAN_HEIGHT
from services.sim.tasks import all_tasks, find_task
from services.sim.tasks.base import BodyState, Contact
from services.sim.tasks.judge import Judge

from .support import snapshot

World = Mapping[str, Any]
DOOR = {"door_hinge": 0.0, "door_lever": 0.0, "door_latch": 0.0}
WRIST = Contact("left", "wrist", "jamb")


def at(x: float, y: float, yaw: float = 0.0, **more: Any) -> World:
    return {"robot": BodyState.upright(x, y, 0.82, yaw), "joints": DOOR, **more}


def cart(x: float, y: float = PUSH_LANE, yaw: float = 0.0, **more: Any) -> World:
    objects = {"cart": BodyState.upright(x, y, 0.0, yaw)}
    return {
        "joints": {"cart_x": x, "cart_y": y, "cart_yaw": yaw},
        "objects": objects,
        "robot": BodyState.upright(-0.08, PUSH_LANE, 0.82),
        **more,
    }


def door(hinge: float, lever: float = 0.0) -> World:
    return {"joints": {"door_hinge": hinge, "door_lever": lever, "door_latch": 0.0}}


LEFT_CAN, RIGHT_CAP = Contact("left", "finger", "can"), Contact("right", "palm", "cap")


def hammer(x: float, z: float, speed: float = 0.0, *contacts: Contact) -> World:
    """A hammer ``x`` from the middle of a trolley that is turned round, ``z`` above the floor."""
    place = BodyState.upright(0.7 - x, -0.7, z)
    objects = {
        "hammer": type(place)(place.position, place.quaternion, speed),
        "cart": BodyState.upright(0.7, -0.7, 0.0, math.pi),
    }
    return {"objects": objects, "contacts": dict.fromkeys(contacts, 5.0)}


def tool(x: float, speed: float = 0.0, *contacts: Contact) -> World:
    place = BodyState.upright(0.4 + x, 0.0, 0.76)
    moving = type(place)(place.position, place.quaternion, speed)
    objects = {"tool": moving, "box": BodyState.upright(0.4, 0.0, 0.74)}
    return {"objects": objects, "contacts": dict.fromkeys(contacts, 5.0)}


def cap(lift: float, *contacts: Contact) -> World:
    """A cap ``lift`` above its seat on a can that lies on its side."""
    quarter = math.sqrt(0.5)
    can = BodyState(np.array([0.4, 0.0, 0.9]), np.array([quarter, 0.0, quarter, 0.0]))
    objects = {"can": can, "cap": BodyState.upright(0.4 + CAN_HEIGHT + lift, 0.0, 0.9)}
    return {"objects": objects, "contacts": dict.fromkeys(contacts, 5.0)}


ON_TRAY = Contact("", "cart tray", "hammer")
IN_BOX, ON_TABLE = Contact("", "box", "tool"), Contact("", "table", "tool")
HELD_HAMMER, HELD_TOOL = Contact("right", "finger", "hammer"), Contact("right", "finger", "tool")
LIFT_HAMMER = (0.5, hammer(0.0, 1.0, 0.0, HELD_HAMMER))
LIFT_TOOL = (0.5, tool(0.0, 0.0, HELD_TOOL))
BOTH = (LEFT_CAN, RIGHT_CAP)


def play(task: str, *acts: tuple[float, World]) -> Judge:
    """Judge a sequence of (duration [s], world)."""
    judge, tick = Judge(find_task(task)), 0
    for duration, world in acts:
        for _ in range(round(duration * 100)):
            judge.tick(snapshot(tick / 100, **world))
            tick += 1
    return judge


REACHED: dict[str, list[tuple[float, World]]] = {
    "door/walk": [(0.6, at(0.05, 0.05))],
    "door/unlock": [(0.1, door(0.0, 0.4)), (0.1, door(0.05, 0.4)), (1.0, door(0.0))],
    "door/push": [(0.6, at(1.3, 0.1))],
    "bench/walk": [(0.6, cart(0.82))],
    "bench/hammer": [LIFT_HAMMER, (1.1, hammer(0.2, 0.75, 0.0, ON_TRAY))],
    "hardware/tool": [LIFT_TOOL, (1.1, tool(0.05, 0.0, IN_BOX))],
    "hardware/cap": [(0.3, cap(0.0, *BOTH)), (0.6, cap(0.04, *BOTH))],
    "bench/push": [(0.5, cart(1.5)), (0.6, cart(PUSH_GOAL[0] + 0.1))],
}


assert set(REACHED) == set(all_tasks())


@pytest.mark.parametrize("task", REACHED)
def test_goal_reached(task: str) -> None:
    judge = play(task, *REACHED[task])
    assert judge.verdict is TaskVerdict.SUCCESS, judge.done


@pytest.mark.parametrize("task", REACHED)
def test_goal_reached_with_a_collision(task: str) -> None:
    hit = [
        (d, {**world, "contacts": {**world.get("contacts", {}), WRIST: 20.0}})
        for d, world in REACHED[task]
    ]
    judge = play(task, *hit)
    assert judge.verdict is TaskVerdict.PARTIAL
    assert "left wrist on jamb" in judge.reason


FAR_AWAY = BodyState.upright(-3.0, 0.0, 0.82)
FAR: dict[str, World] = {
    "door": {"robot": FAR_AWAY, "joints": DOOR},
    "bench": {
        **cart(0.5, robot=FAR_AWAY),
        "objects": {**cart(0.5)["objects"], "hammer": BodyState.upright(0.4, -0.2, 0.96)},
    },
    "hardware": {},
}


@pytest.mark.parametrize("task", REACHED)
def test_goal_reached_too_late(task: str) -> None:
    nowhere = dict(FAR[task.split("/", maxsplit=1)[0]])
    if task.startswith("hardware/"):
        nowhere = dict(tool(0.2) if task == "hardware/tool" else cap(0.0))
    limit = find_task(task).limit
    judge = play(task, (limit + 0.01, nowhere), *REACHED[task])
    assert judge.verdict is TaskVerdict.FAILURE
    assert judge.reason.startswith("not within")
    assert judge.time == pytest.approx(limit)


MISSED: list[tuple[str, World]] = [
    ("door/walk", at(-0.01, 0.0)),
    ("door/walk", at(0.1, 0.0, 0.31)),
    ("door/walk", at(0.2, 0.31)),
    ("door/walk", at(0.1, 0.0, loads=(300.0, 10.0))),
    ("door/unlock", door(0.043, 0.6)),
    ("door/push", at(1.19, 0.0)),
    ("door/push", at(1.3, 0.36)),
    ("bench/walk", cart(0.82, robot=BodyState.upright(0.03, PUSH_LANE, 0.82))),
    ("bench/walk", cart(0.82, robot=BodyState.upright(-0.08, PUSH_LANE, 0.82, math.radians(10.5)))),
    ("bench/push", cart(PUSH_GOAL[0] - 0.11)),
    ("bench/push", cart(PUSH_GOAL[0], PUSH_LANE + 0.16)),
    ("bench/push", cart(PUSH_GOAL[0], PUSH_LANE, math.radians(15.5))),
]


@pytest.mark.parametrize(("task", "world"), MISSED)
def test_goal_missed_by_a_little(task: str, world: World) -> None:
    assert play(task, (3.0, world)).verdict is TaskVerdict.RUNNING


MISSED_THINGS: list[tuple[str, list[tuple[float, World]]]] = [
    # Still held, never lifted, beside the tray, rolling, hovering.
    ("bench/hammer", [LIFT_HAMMER, (3.0, hammer(0.2, 0.75, 0.0, ON_TRAY, HELD_HAMMER))]),
    ("bench/hammer", [(3.0, hammer(0.2, 0.75, 0.0, ON_TRAY))]),
    ("bench/hammer", [LIFT_HAMMER, (3.0, hammer(0.29, 0.75, 0.0, ON_TRAY))]),
    ("bench/hammer", [LIFT_HAMMER, (3.0, hammer(0.2, 0.75, 0.06, ON_TRAY))]),
    ("bench/hammer", [LIFT_HAMMER, (3.0, hammer(0.2, 0.75))]),
    ("hardware/tool", [LIFT_TOOL, (3.0, tool(0.05, 0.0, IN_BOX, HELD_TOOL))]),
    ("hardware/tool", [LIFT_TOOL, (3.0, tool(0.05, 0.0, IN_BOX, ON_TABLE))]),
    ("hardware/tool", [LIFT_TOOL, (3.0, tool(0.12, 0.0, IN_BOX))]),
    # Both hands but the cap still on, or hardly off; off in one hand; both things in one hand.
    ("hardware/cap", [(3.0, cap(0.0, *BOTH))]),
    ("hardware/cap", [(3.0, cap(0.03, *BOTH))]),
    ("hardware/cap", [(0.3, cap(0.0, *BOTH)), (3.0, cap(0.04, RIGHT_CAP))]),
    ("hardware/cap", [(3.0, cap(0.04, Contact("right", "finger", "can"), RIGHT_CAP))]),
]


@pytest.mark.parametrize(("task", "acts"), MISSED_THINGS)
def test_things_not_where_they_should_be(task: str, acts: list[tuple[float, World]]) -> None:
    assert play(task, *acts).verdict is TaskVerdict.RUNNING


def test_a_moving_robot_has_not_arrived() -> None:
    walking = BodyState.upright(0.1, 0.0, 0.82)
    walking = type(walking)(walking.position, walking.quaternion, speed=0.2)
    assert play("door/walk", (3.0, {**at(0.1, 0.0), "robot": walking})).verdict is (
        TaskVerdict.RUNNING
    )


@pytest.mark.parametrize(
    "world", [cart(PUSH_GOAL[0] + 0.4), cart(1.2, PUSH_LANE + 0.35), cart(1.2, yaw=0.6)]
)
def test_a_trolley_off_its_lane_is_lost(world: World) -> None:
    judge = play("bench/push", (0.5, world))
    assert judge.verdict is TaskVerdict.FAILURE
    assert judge.reason == "the trolley left its lane"


def test_an_unlocked_door_does_not_count_if_the_robot_falls_within_a_second() -> None:
    judge = play("door/unlock", (0.5, door(0.1, 0.4)), (0.1, {**door(0.1), "fallen": True}))
    assert judge.verdict is TaskVerdict.FAILURE


@pytest.mark.parametrize("task", sorted(all_tasks()))
def test_tasks_are_complete(task: str) -> None:
    found = find_task(task)
    assert 10.0 < found.limit <= 70.0
    assert "goal" in found.marks
    assert all(text for text in (found.goal, found.rule, found.origin))
    assert len({stage.name for stage in found.stages}) == len(found.stages)
    assert {s.after for s in found.stages} <= {"", *(s.name for s in found.stages)}
    assert bool(found.link) == (found.noise.position > 0.0) == task.startswith("hardware/")


def test_an_unknown_task_is_refused_with_the_known_ones() -> None:
    from services.sim.errors import TaskError

    with pytest.raises(TaskError, match=r"unknown task 'moon': expected one of bench/hammer.*"):
        find_task("moon")
