"""Tasks in the physics: ends reached and missed by moving things by hand."""

import math

import numpy as np
import pytest

from common.schemas import TaskVerdict
from lab.trials.spec import TrialSpec
from lab.trials.stack import TaskStack
from services.sim.scenes.bench import GRIP_BELOW, PUSH_GOAL, PUSH_LANE
from services.sim.scenes.cap import CAN_GRIP_HEIGHT
from services.sim.scenes.cart import TRAY_HEIGHT
from services.sim.scenes.furniture import TABLE_TOP
from services.sim.scenes.tool import BOX_PLACE, GRIP_HEIGHT
from services.sim.tasks import all_tasks

from .support import Workshop

SUCCESS, PARTIAL, FAILURE = TaskVerdict.SUCCESS, TaskVerdict.PARTIAL, TaskVerdict.FAILURE


@pytest.mark.parametrize("task", sorted(all_tasks()))
def test_starts_touch_nothing_and_lie_still(task: str) -> None:
    shop = Workshop(all_tasks()[task].scene, task)
    trial = shop.trial
    assert trial is not None
    starts = set()
    for seed in range(25):
        shop.data.qpos[: shop.addresses.scene] = shop._robot
        shop.data.qvel[:] = 0.0
        trial.restart(seed)
        x, y, _, w, _, _, z = shop.data.qpos[:7].tolist()
        shop.place_robot(x, y, 2.0 * math.atan2(z, w))
        before = {name: pose.position for name, pose in trial.view.objects().items()}
        shop.time = 0.0
        shop.run(0.03)
        assert not shop.undesired, (seed, shop.undesired)
        for name, pose in trial.view.objects().items():
            assert np.abs(pose.position - before[name]).max() < 1e-3, (seed, name)
        assert shop.verdict is TaskVerdict.RUNNING
        starts.add(shop.data.qpos.tobytes())
    assert len(starts) == 25


def test_starts_vary_by_a_factor_around_the_same_means() -> None:
    """As the plant that a trial is run with, and no wider or narrower than told."""
    places = []
    for factor in (0.0, 1.0, 3.0):
        settings = TrialSpec(task="door/unlock", seed=5, task_spread=factor)
        data = TaskStack(settings).plant.plant.data
        places.append(data.qpos[:2].copy())
    mean, usual, wide = places
    assert mean == pytest.approx([0.22, 0.05], abs=1e-12)
    assert np.abs(usual - mean).min() > 1e-3
    assert wide - mean == pytest.approx(3.0 * (usual - mean), abs=1e-12)


def test_the_same_seed_is_the_same_start() -> None:
    one, two, other = (Workshop("bench", "bench/hammer", seed) for seed in (4, 4, 5))
    assert one.data.qpos.tobytes() == two.data.qpos.tobytes() != other.data.qpos.tobytes()


def unlock(shop: Workshop) -> None:
    shop.torque("door_lever", 1.5)
    shop.torque("door_hinge", 5.0)
    shop.run(0.6)
    shop.torque("door_hinge", 0.0)


def test_unlock() -> None:
    shop = Workshop("door", "door/unlock")
    unlock(shop)
    assert shop.verdict is TaskVerdict.RUNNING
    shop.run(1.1)
    assert shop.verdict is SUCCESS
    assert shop.trial is not None
    assert list(shop.trial.judge.done) == ["lever pressed", "door ajar", "door unlocked"]


def test_unlock_with_a_foot_on_the_leaf() -> None:
    shop = Workshop("door", "door/unlock")
    shop.place_robot(0.58, 0.0)
    shop.run(0.02)
    shop.place_robot(0.2, 0.0)
    unlock(shop)
    shop.run(1.1)
    assert shop.verdict is PARTIAL
    assert {"left foot on leaf", "right foot on leaf"} <= set(shop.undesired)
    assert "right foot on leaf" in shop.reason


def test_a_wrist_on_the_jamb_is_told_by_name() -> None:
    shop = Workshop("door", "door/walk")
    wrist = shop.model.geom("l_wrist_col").id
    place = shop.data.geom_xpos[wrist] - shop.data.qpos[:3]
    shop.place_robot(0.62 - place[0], 0.51 - place[1])
    shop.run(0.02)
    assert "left wrist on jamb" in shop.undesired


def test_a_touch_between_two_looks_of_the_judge_is_not_missed() -> None:
    shop = Workshop("door", "door/walk")
    shop.run(0.002)
    shop.place_robot(0.58, 0.0)
    shop.run(0.003)
    shop.place_robot(-0.5, 0.0)
    shop.run(0.02)
    assert "left foot on leaf" in shop.undesired


def test_walk_through_the_door() -> None:
    shop = Workshop("door", "door/push")
    shop.set("door_hinge", 1.7)
    shop.place_robot(1.35, 0.05)
    shop.run(0.6)
    assert shop.verdict is SUCCESS


@pytest.mark.parametrize(("task", "x", "y"), [("door/walk", 0.12, 0.0), ("bench/walk", -0.1, -1.2)])
def test_walk(task: str, x: float, y: float) -> None:
    shop = Workshop(task.split("/", maxsplit=1)[0], task)
    shop.run(0.3)
    assert shop.verdict is TaskVerdict.RUNNING
    shop.place_robot(x, y)
    shop.run(0.6)
    assert shop.verdict is SUCCESS


def grip(shop: Workshop, side: str, joint: str, below: float, opening: float = 0.034) -> None:
    """Bring a thing's grip, ``below`` its origin [m], between the fingers of ``side``."""
    shop.close_hand(side, opening)
    shop.put(joint, shop.hand(side) + np.array([0.0, 0.0, below]))


def lift_hammer(shop: Workshop) -> None:
    grip(shop, "right", "hammer_free", GRIP_BELOW)
    shop.run(0.25, until=lambda: "hammer off the hanger" in shop.trial.judge.done)  # type: ignore[union-attr]


def test_hammer() -> None:
    shop = Workshop("bench", "bench/hammer")
    shop.run(0.1)
    lift_hammer(shop)
    shop.put("hammer_free", np.array([0.68, -0.72, TRAY_HEIGHT + 0.30]))
    spent = shop.run(4.0, until=lambda: shop.verdict is not TaskVerdict.RUNNING)
    assert shop.verdict is SUCCESS, shop.reason
    assert spent > 1.0
    assert shop.undesired == []


def test_a_hammer_dropped_fails() -> None:
    shop = Workshop("bench", "bench/hammer")
    lift_hammer(shop)
    shop.put("hammer_free", np.array([0.2, -0.9, 0.5]))
    shop.run(1.0)
    assert shop.verdict is FAILURE
    assert shop.reason == "the hammer fell to the floor"


def test_a_hammer_put_on_the_tray_without_a_hand_is_no_success() -> None:
    shop = Workshop("bench", "bench/hammer")
    shop.put("hammer_free", np.array([0.68, -0.72, TRAY_HEIGHT + 0.30]))
    shop.run(2.5)
    assert shop.verdict is TaskVerdict.RUNNING


def test_a_hammer_against_the_chest_is_told_by_name() -> None:
    shop = Workshop("bench", "bench/hammer")
    shop.put("hammer_free", np.array(shop.data.geom("chest_col").xpos) + np.array([0.09, 0.0, 0.0]))
    shop.run(0.02)
    assert "chest on hammer" in shop.undesired


def push(shop: Workshop, force: tuple[float, float, float], distance: float) -> None:
    start = shop.at("cart_x")
    shop.pull("cart", force)
    shop.run(4.0, until=lambda: shop.at("cart_x") - start > distance)
    shop.pull("cart", (0.0, 0.0, 0.0))


def test_push() -> None:
    shop = Workshop("bench", "bench/push")
    push(shop, (40.0, 0.0, 0.0), 0.45)
    shop.run(3.0, until=lambda: shop.verdict is not TaskVerdict.RUNNING)
    assert abs(shop.at("cart_x") - PUSH_GOAL[0]) < 0.25
    assert shop.verdict is SUCCESS, shop.reason
    assert abs(shop.at("cart_y") - PUSH_LANE) < 0.05


def test_a_trolley_pushed_half_way_is_part_of_the_task() -> None:
    shop = Workshop("bench", "bench/push")
    push(shop, (40.0, 0.0, 0.0), 0.4)
    shop.time = 59.7
    shop.run(0.4)
    assert shop.verdict is PARTIAL
    assert shop.reason.startswith("only half way; not within 60 s")


def test_a_trolley_pushed_aside_fails() -> None:
    shop = Workshop("bench", "bench/push")
    shop.pull("cart", (0.0, 150.0, 0.0))
    shop.run(1.5, until=lambda: shop.verdict is not TaskVerdict.RUNNING)
    assert (shop.verdict, shop.reason) == (FAILURE, "the trolley left its lane")


def test_knees_on_the_trolley_are_told_by_name() -> None:
    shop = Workshop("bench", "bench/push")
    knee = shop.data.geom("l_shank_up_col").xpos - shop.data.qpos[:3]
    shop.place_robot(0.52 - 0.06 - float(knee[0]), PUSH_LANE)
    shop.run(0.02)
    assert {"left knee on cart", "right knee on cart"} <= set(shop.undesired)


def test_tool() -> None:
    shop = Workshop("tool", "hardware/tool")
    shop.run(0.1)
    grip(shop, "right", "tool_free", -GRIP_HEIGHT)
    shop.run(0.25)
    shop.put("tool_free", np.array([*BOX_PLACE, TABLE_TOP + 0.02]))
    shop.run(2.5, until=lambda: shop.verdict is not TaskVerdict.RUNNING)
    assert shop.verdict is SUCCESS, (shop.reason, shop.trial and shop.trial.judge.done)


def test_a_tool_beside_the_box_is_no_success() -> None:
    shop = Workshop("tool", "hardware/tool")
    grip(shop, "right", "tool_free", -GRIP_HEIGHT)
    shop.run(0.25)
    shop.put("tool_free", np.array([0.42, 0.3, TABLE_TOP + 0.01]))
    shop.time = 58.0
    shop.run(2.1)
    assert shop.verdict is PARTIAL
    assert shop.reason.startswith("only tool lifted")


def test_a_tool_on_the_floor_fails() -> None:
    shop = Workshop("tool", "hardware/tool")
    shop.put("tool_free", np.array([0.42, -0.9, 0.3]))
    shop.run(0.6)
    assert (shop.verdict, shop.reason) == (FAILURE, "tool or box fell to the floor")


def hold_both(shop: Workshop) -> None:
    grip(shop, "left", "can_free", -CAN_GRIP_HEIGHT, 0.050)
    grip(shop, "right", "cap_free", -0.026, 0.044)


def test_cap() -> None:
    shop = Workshop("cap", "hardware/cap")
    shop.run(0.05)
    for _ in range(9):
        # Held again and again: nailed fingers push things out.
        hold_both(shop)
        shop.run(0.1)
    assert shop.verdict is SUCCESS, (shop.reason, shop.trial and shop.trial.judge.done)
    assert shop.undesired == []


def test_a_cap_that_came_off_without_hands_is_only_a_part() -> None:
    shop = Workshop("cap", "hardware/cap")
    shop.put("cap_free", np.array([0.42, 0.2, TABLE_TOP + 0.001]))
    shop.time = 59.5
    shop.run(0.6)
    assert shop.verdict is PARTIAL
    assert shop.reason.startswith("only cap off")


def test_a_can_on_the_floor_fails() -> None:
    shop = Workshop("cap", "hardware/cap")
    shop.put("can_free", np.array([-0.5, 0.9, 0.2]))
    shop.run(0.5)
    assert (shop.verdict, shop.reason) == (FAILURE, "the can fell to the floor")


@pytest.mark.parametrize("task", sorted(all_tasks()))
def test_every_task_ends_by_a_fall_and_by_time(task: str) -> None:
    shop = Workshop(all_tasks()[task].scene, task)
    shop.time = all_tasks()[task].limit - 0.005
    shop.run(0.02)
    assert shop.verdict is FAILURE
    assert shop.reason.startswith("not within")
    assert shop.trial is not None
    shop.trial.restart(0)
    shop.fallen, shop.time = True, 0.0
    shop.run(0.02)
    assert (shop.verdict, shop.reason) == (FAILURE, "the robot fell")
