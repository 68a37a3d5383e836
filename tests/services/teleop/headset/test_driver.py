"""Whoever drives from a page: what moves, what never does, and who may."""

import math
from typing import Any

import numpy as np
import pytest

from common.schemas import GaitOutcome, GuardMode
from common.schemas.arrays import Float64Array as Array
from common.topics import (
    ESTOP,
    PLANT_STATUS,
    TELEOP_CLAIM,
    TELEOP_DEVICE,
    TELEOP_SETPOINT,
    WBC_TARGET,
)
from services.teleop.headset.driver import GAIT_KEYS
from services.teleop.headset.view import FOCAL_LENGTH
from tests.services.teleop.support import NOBODY, FakeController, at_left, authority, plant_status

from .people import Room, grip

OTHER = authority("teleop", 5)


def hands(setpoint: Any) -> Array:
    return np.concatenate(
        [setpoint.left_hand_position_in_body, setpoint.right_hand_position_in_body]
    )


def steps(room: Room) -> Array:
    """How far the hands move from each set-point to the next [m]."""
    all_hands = np.array([hands(setpoint) for setpoint in room.setpoints])
    return np.abs(np.diff(all_hands, axis=0))


def test_engaging_moves_nothing_and_then_the_hand_moves_as_the_controller() -> None:
    room = Room()
    room.bench.inputs.put(WBC_TARGET, at_left(0.35, 0.2, 0.1))
    person = room.enter().wear(0.2)
    person.squeeze("left", 0.3)
    assert room.has_robot
    start = hands(room.setpoints[0])
    np.testing.assert_allclose(start[:3], [0.35, 0.2, 0.1])
    assert steps(room).max() < 1e-9
    # Up 5 cm, ahead 3 cm, to the right 2 cm, in WebXR's axes.
    person.left["position"] = [-0.23, 1.25, -0.43]
    person.wear(0.1)
    moved = hands(room.setpoints[-1]) - start
    np.testing.assert_allclose(moved, [0.03, -0.02, 0.05, 0.0, 0.0, 0.0], atol=1e-9)


def test_the_head_alone_moves_no_hand() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left").squeeze("right", 0.2)
    start = len(room.setpoints)
    for turn in np.linspace(0.0, 1.5, 20):
        person.head["position"] = [0.3 * turn, 1.6 - 0.1 * turn, 0.2 * turn]
        person.head["quaternion"] = [math.cos(turn / 2), 0.0, math.sin(turn / 2), 0.0]
        person.wear(0.04)
    assert len(room.setpoints) > start + 10
    assert steps(room).max() < 1e-9


def test_samples_reach_the_bus_at_the_headsets_rate_and_setpoints_at_33_hz() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    devices, setpoints = (len(room.bench.messages(t)) for t in (TELEOP_DEVICE, TELEOP_SETPOINT))
    person.wear(1.0)
    assert len(room.bench.messages(TELEOP_DEVICE)) == devices + 50
    assert len(room.setpoints) - setpoints in (33, 34)
    assert room.bench.messages(TELEOP_DEVICE)[-1].device == "webxr"


@pytest.mark.parametrize(
    ("side", "button", "gait"),
    [
        ("left", "upper", "FORWARD"),
        ("right", "upper", "BACKWARD"),
        ("left", "stick_pressed", "SIDE_LEFT"),
        ("right", "stick_pressed", "SIDE_RIGHT"),
        ("left", "lower", "TURN_LEFT"),
        ("right", "lower", "TURN_RIGHT"),
    ],
)
def test_a_button_walks_once_and_takes_a_free_robot(side: str, button: str, gait: str) -> None:
    room = Room()
    person = room.enter().wear(0.1)
    getattr(person, side)[button] = True
    person.wear(0.4)
    assert room.has_robot
    assert room.gaits == [gait]


def test_every_gait_has_a_key() -> None:
    assert {gait.name for gait in GAIT_KEYS} == {
        "FORWARD",
        "BACKWARD",
        "SIDE_LEFT",
        "SIDE_RIGHT",
        "TURN_LEFT",
        "TURN_RIGHT",
    }


def test_a_refused_gait_is_counted_for_the_page_that_drives() -> None:
    room = Room(FakeController(lambda _request, _number: [GaitOutcome.REFUSED]))
    person, watcher = room.enter(), room.enter()
    person.key("w", run=0.3)
    assert (person.told["refusals"], watcher.told["refusals"]) == (1, 0)
    assert room.notice == "refused: because"


def test_a_clutch_takes_the_robot_from_nobody_but_the_gesture_does() -> None:
    room = Room(FakeController(authority=OTHER))
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.3)
    assert person.told["refusals"] == 1
    assert "teleop has the robot" in room.notice
    assert room.bench.messages(TELEOP_CLAIM)[-1].act == 0
    person.left["trigger"] = 1.0
    person.right |= {"trigger": 1.0, "squeeze": 1.0}
    person.wear(0.9)
    assert room.bench.messages(TELEOP_CLAIM)[-1].act == 0
    person.wear(0.3)
    assert room.bench.messages(TELEOP_CLAIM)[-1].act == 1
    assert room.bench.messages(TELEOP_CLAIM)[-1].wants


def test_a_headset_that_gets_the_robot_back_starts_where_another_operator_left_it() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    person.left["position"] = [-0.25, 1.3, -0.4]
    person.wear(0.1)
    room.bench.controller.authority = OTHER.model_copy(update={"changes": 5})
    person.wear(0.1)
    assert not room.has_robot
    sent = len(room.setpoints)
    room.bench.inputs.put(WBC_TARGET, at_left(0.4, 0.1, -0.1))
    person.wear(0.1)
    room.bench.controller.authority = NOBODY.model_copy(update={"changes": 6})
    person.left["squeeze"] = 0.0
    person.wear(0.1)
    person.squeeze("left", 0.3)
    assert room.has_robot
    for setpoint in room.setpoints[sent:]:
        np.testing.assert_allclose(hands(setpoint)[:3], [0.4, 0.1, -0.1], atol=1e-9)


def test_a_second_page_watches_until_it_takes_over_without_a_jump() -> None:
    room = Room()
    first, second = room.enter(), room.enter()
    first.key("Enter", *"ii", run=0.1)
    assert room.has_robot
    sent = len(room.setpoints)
    second.send("key", key="w")
    first.watch(0.1)
    assert room.gaits == []
    assert second.told["refusals"] == 1
    assert "another page drives" in second.told["notice"]
    second.key("Enter", run=0.3)
    assert room.has_robot
    assert (first.told["drives"], second.told["drives"]) == (False, True)
    # The first page's motion has ended where it was.
    assert np.abs(hands(room.setpoints[-1]) - hands(room.setpoints[sent])).max() < 0.04
    assert steps(room).max() < 0.35 * 0.03 + 1e-9
    second.key("w")
    assert room.gaits == ["FORWARD"]
    first.send("key", key="s")
    second.watch(0.1)
    assert room.gaits == ["FORWARD"]


def test_a_page_that_is_reloaded_while_walking_frees_the_hands_and_has_to_ask_anew() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    person.left["upper"] = True
    person.wear(0.1)
    person.left["position"] = [-0.25, 1.3, -0.4]
    person.wear(0.1)
    person.leave()
    room.run(0.05)
    sent, claims = len(room.setpoints), len(room.bench.messages(TELEOP_CLAIM))
    reloaded = room.enter()
    reloaded.watch(0.5)
    assert len(room.setpoints) == sent
    assert len(room.bench.messages(TELEOP_CLAIM)) == claims
    # The controller takes the robot from an operator that is silent.
    room.bench.controller.authority = authority(previous="headset")
    reloaded.watch(0.3)
    assert not room.has_robot
    assert not room.bench.messages(TELEOP_CLAIM)[-1].wants
    reloaded.left = grip(0.1, 0.7, -0.2)
    reloaded.wear(0.1)
    reloaded.squeeze("left", 0.3)
    assert room.has_robot
    assert len(room.setpoints) > sent
    start = hands(room.bench.inputs.latest(WBC_TARGET))
    np.testing.assert_allclose(hands(room.setpoints[-1]), start, atol=1e-9)


def test_silence_of_the_page_stops_setpoints_and_its_return_engages_anew() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    room.run(0.35)
    sent, before = len(room.setpoints), hands(room.setpoints[-1])
    room.run(0.3)
    assert len(room.setpoints) == sent
    person.left["position"] = [-0.4, 0.9, -0.1]
    person.wear(0.2)
    assert len(room.setpoints) > sent
    np.testing.assert_allclose(hands(room.setpoints[-1]), before, atol=1e-9)


def test_silence_of_the_page_ends_what_its_keys_began() -> None:
    room = Room()
    person = room.enter()
    person.key("Enter", *"iiii", run=0.1)
    room.run(0.6)
    sent = len(room.setpoints)
    person.watch(0.3)
    assert len(room.setpoints) > sent
    # Neither a jump by what the silence hid nor a motion that goes on.
    assert steps(room).max() < 0.35 * 0.03 + 1e-9
    assert np.abs(hands(room.setpoints[-1]) - hands(room.setpoints[sent])).max() < 1e-9


def test_a_key_that_was_held_up_does_nothing_unless_it_is_the_stop() -> None:
    room = Room()
    person = room.enter()
    person.key("Enter")
    person.send("key", late=2.0, key="w")
    person.watch(0.1)
    assert room.gaits == []
    assert room.operator.driver.late == 1
    assert room.operator.hub.status["refused"]["late"] == 1
    person.send("key", late=2.0, key="x")
    person.watch(0.1)
    assert [stop for stop in room.bench.messages(ESTOP) if stop.pressed]


def test_anybody_stops_the_robot_and_only_who_drives_ends_the_stop() -> None:
    room = Room()
    first, watcher = room.enter(), room.enter()
    first.key("Enter")
    watcher.send("key", key="Backspace")
    first.watch(0.1)
    assert room.bench.messages(ESTOP)[-1].pressed
    stopped = plant_status(guard=GuardMode.ESTOP, stops=1, stopped_by="headset")
    room.bench.inputs.put(PLANT_STATUS, stopped)
    first.watch(0.1)
    assert room.operator.hub.status["stop"] == "stopped by headset"
    assert not room.bench.messages(ESTOP)[-1].pressed


def test_all_four_buttons_are_the_stop_and_no_gait() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    for side in (person.left, person.right):
        side |= {"upper": True, "lower": True}
    person.wear(0.1)
    assert [stop for stop in room.bench.messages(ESTOP) if stop.pressed]
    assert room.gaits == []


def test_the_stop_button_is_there_as_long_as_a_page_is() -> None:
    room = Room()
    room.run(0.5)
    assert room.bench.messages(ESTOP) == []
    person = room.enter()
    person.watch(0.5)
    beats = len(room.bench.messages(ESTOP))
    assert beats >= 4
    room.run(0.4)
    silent = len(room.bench.messages(ESTOP))
    room.run(0.5)
    assert len(room.bench.messages(ESTOP)) == silent


def test_a_hidden_page_drives_no_longer() -> None:
    room = Room()
    person = room.enter()
    person.key("Enter", "i")
    person.send("away")
    room.run(0.05)
    sent = len(room.setpoints)
    room.run(0.2)
    assert len(room.setpoints) == sent
    assert not person.told["drives"]


def test_a_page_whose_clock_stood_still_while_it_was_hidden_is_not_late() -> None:
    room = Room()
    person = room.enter()
    person.send("away")
    person.clock_ms -= 60_000.0
    person.watch(0.1).key("w")
    assert room.gaits == ["FORWARD"]
    assert room.operator.driver.late == 0


def test_the_page_cannot_end_the_operator() -> None:
    room = Room()
    person = room.enter()
    person.key("Esc")
    assert room.operator.exit_code is None
    assert person.told["refusals"] == 1


def test_a_dragged_hand_stays_under_the_pointer() -> None:
    room = Room()
    person = room.enter()
    person.key("Enter")
    before = np.array(room.operator.hub.status["hands"]["left"]["picture"]["left"])
    person.send("drag", side="left", begins=True, across=0.0, down=0.0)
    room.run(0.02)
    way = np.array([0.06, -0.04])
    for _ in range(15):
        person.send("drag", side="left", across=way[0], down=way[1])
        room.run(0.1)
    after = np.array(room.operator.hub.status["hands"]["left"]["picture"]["left"])
    np.testing.assert_allclose(after - before, way, atol=2e-3)
    assert steps(room).max() < 0.35 * 0.03 + 1e-9


def test_a_drag_asks_for_a_free_robot_and_starts_when_it_is_granted() -> None:
    room = Room(FakeController(grants=False))
    person = room.enter()
    person.send("drag", side="right", begins=True, across=0.0, down=0.0)
    person.watch(0.2)
    person.send("drag", side="right", across=0.3, down=0.0)
    person.watch(0.1)
    room.bench.controller.grants = True
    person.watch(0.2)
    assert room.has_robot
    person.send("drag", side="right", across=0.35, down=0.0)
    room.run(0.1)
    start = hands(room.setpoints[-1])
    for _ in range(10):
        person.send("drag", side="right", across=0.4, down=0.0)
        room.run(0.1)
    # Only what was dragged since, 0.05 heights of the picture to the right.
    ahead = room.operator.hub.status["hands"]["right"]["seen"]["left"][2]
    moved = hands(room.setpoints[-1]) - start
    np.testing.assert_allclose(moved, [0, 0, 0, 0, -0.05 * ahead / FOCAL_LENGTH, 0], atol=1e-3)


def test_keys_go_on_from_where_the_headset_left_the_hands() -> None:
    room = Room()
    person = room.enter().wear(0.1)
    person.squeeze("left", 0.2)
    person.left["position"] = [-0.25, 1.26, -0.4]
    person.wear(0.1)
    held = hands(room.setpoints[-1])
    person.left["squeeze"] = 0.0
    person.wear(0.1)
    person.key("2", run=0.1)
    assert room.operator.hub.status["operator"]["headset"]
    person.key("u", run=0.6)
    assert not room.operator.hub.status["operator"]["headset"]
    moved = hands(room.setpoints[-1]) - held
    np.testing.assert_allclose(moved, [0, 0, 0, 0, 0, 0.02], atol=1e-3)
