from collections.abc import Sequence

import numpy as np
import pytest

from common.robot.rotations import rotation_between
from common.schemas import Gait, GaitOutcome, GaitRequest, PlantAction, PlantRequest
from common.topics import PLANT_REQUEST, PLANT_STATUS, TELEOP_GAIT, TELEOP_SETPOINT
from services.teleop.keyboard.console import Console
from services.teleop.keyboard.keymap import BY_KEY
from services.teleop.keyboard.requests import SentRequest
from services.teleop.targets.hand import home_pose

from .desk import Desk
from .support import FakeController, plant_status


@pytest.mark.parametrize(
    ("key", "gait"),
    [
        ("w", Gait.FORWARD),
        ("s", Gait.BACKWARD),
        ("a", Gait.TURN_LEFT),
        ("d", Gait.TURN_RIGHT),
        ("q", Gait.SIDE_LEFT),
        ("e", Gait.SIDE_RIGHT),
    ],
)
def test_gait_keys(key: str, gait: Gait) -> None:
    desk = Desk().type(key)
    (request,) = desk.bench.messages(TELEOP_GAIT)
    assert isinstance(request, GaitRequest)
    assert request.gait is gait
    assert request.header.stamp == 123


@pytest.mark.parametrize(
    ("keys", "step"),
    [
        (("i",), (0.02, 0.0, 0.0)),
        (("up", "up"), (0.04, 0.0, 0.0)),
        (("k",), (-0.02, 0.0, 0.0)),
        (("down",), (-0.02, 0.0, 0.0)),
        (("j",), (0.0, 0.02, 0.0)),
        (("left",), (0.0, 0.02, 0.0)),
        (("l",), (0.0, -0.02, 0.0)),
        (("right",), (0.0, -0.02, 0.0)),
        (("u",), (0.0, 0.0, 0.02)),
        (("o",), (0.0, 0.0, -0.02)),
    ],
)
def test_position_keys_move_the_selected_hand_only(
    keys: tuple[str, ...], step: tuple[float, float, float]
) -> None:
    desk = Desk()
    left, right = desk.hand("left")[0], desk.hand("right")[0]
    desk.type("2", *keys, run=3.0)
    np.testing.assert_allclose(desk.hand("right")[0] - right, step, atol=2e-4)
    np.testing.assert_allclose(desk.hand("left")[0], left, atol=1e-4)
    desk.type("3", *keys, run=3.0)
    np.testing.assert_allclose(desk.hand("left")[0] - left, step, atol=2e-4)


@pytest.mark.parametrize(
    ("key", "axis"),
    [
        ("y", (1, 0, 0)),
        ("t", (-1, 0, 0)),
        ("v", (0, 1, 0)),
        ("f", (0, -1, 0)),
        ("z", (0, 0, 1)),
        ("c", (0, 0, -1)),
    ],
)
def test_rotation_keys_turn_about_body_axes(key: str, axis: tuple[int, int, int]) -> None:
    desk = Desk()
    before = desk.hand("left")[1]
    desk.type(key, run=3.0)
    turned = rotation_between(before, desk.hand("left")[1])
    np.testing.assert_allclose(turned, np.radians(5.0) * np.array(axis), atol=2e-3)


def test_a_held_key_moves_smoothly_and_stops_soon_after_its_release() -> None:
    desk = Desk()
    start = len(desk.bench.messages(TELEOP_SETPOINT))
    desk.type(*["i"] * 9)
    released = desk.hand("left")[0][0]
    desk.bench.run(3.0)
    assert desk.hand("left")[0][0] - released <= 0.081
    x = [m.left_hand_position_in_body[0] for m in desk.bench.messages(TELEOP_SETPOINT)[start:]]
    speed = np.diff(x) / 0.05
    assert speed.max() <= 0.35 + 1e-9
    assert np.abs(np.diff(speed)).max() / 0.05 <= 2.0 + 1e-6


def test_grip_toggles_the_selected_grippers() -> None:
    def closure(desk: Desk) -> list[float]:
        return list(desk.bench.messages(TELEOP_SETPOINT)[-1].gripper_closure)

    desk = Desk().type("g", run=1.0)
    assert closure(desk) == [1.0, 0.0]
    desk.type("3", "g", run=1.0)
    assert closure(desk) == [1.0, 1.0]
    desk.type("g", run=1.0)
    assert closure(desk) == [0.0, 0.0]


def test_head_keys() -> None:
    desk = Desk().type("m", "m", "m", "n", run=1.0)
    assert desk.bench.messages(TELEOP_SETPOINT)[-1].neck_pitch == pytest.approx(np.radians(10))


def test_home_brings_the_selected_hand_back() -> None:
    desk = Desk().type("i", "u", "z", "h", run=3.0)
    np.testing.assert_allclose(desk.hand("left")[0], home_pose("left").position, atol=1e-4)


def test_plant_keys() -> None:
    desk = Desk().type("p", "space")
    push, pause = desk.bench.messages(PLANT_REQUEST)
    assert isinstance(push, PlantRequest)
    assert push.action is PlantAction.PUSH
    np.testing.assert_array_equal(push.force, [80.0, 0.0, 0.0])
    assert pause.action is PlantAction.PAUSE
    desk.bench.inputs.put(PLANT_STATUS, plant_status(paused=True))
    desk.type("space")
    assert desk.bench.messages(PLANT_REQUEST)[-1].action is PlantAction.RESUME


def test_a_reset_needs_two_presses_in_a_row() -> None:
    desk = Desk().type("r")
    assert "press r once more to reset the plant" in desk.screen.text
    desk.type("i", "r", run=1.5)
    desk.type("b", "r", run=1.5)
    assert desk.bench.messages(PLANT_REQUEST) == []
    desk.type("r", "R")
    assert [m.action for m in desk.bench.messages(PLANT_REQUEST)] == [PlantAction.RESET]


def test_three_presses_ask_once() -> None:
    desk = Desk().type("r", "r", "r")
    assert len(desk.bench.messages(PLANT_REQUEST)) == 1


def test_a_refused_gait_is_shown_with_its_reason() -> None:
    desk = Desk(FakeController(answer=lambda *_: [GaitOutcome.REFUSED])).type("w", run=0.1)
    assert "forward: REFUSED - because" in desk.screen.text


def test_a_gait_while_walking_is_sent_and_its_answer_shown() -> None:
    def answer(_request: GaitRequest, number: int) -> Sequence[GaitOutcome]:
        return [GaitOutcome.REFUSED] if number else [GaitOutcome.ACCEPTED, GaitOutcome.COMPLETED]

    desk = Desk(FakeController(answer=answer)).type("w", "a", run=0.1)
    assert len(desk.bench.messages(TELEOP_GAIT)) == 2
    assert "forward: accepted" in desk.screen.text
    assert "turn left: REFUSED" in desk.screen.text
    assert "refused: because" in desk.screen.text
    desk.bench.run(1.5)
    assert "forward: completed" in desk.screen.text


def test_a_gait_of_a_controller_that_was_restarted_is_shown_as_ended() -> None:
    console = Console()
    for request_id, outcome in enumerate([GaitOutcome.COMPLETED, GaitOutcome.ACCEPTED]):
        console.requests.append(SentRequest(request_id, Gait.FORWARD, 1.0, outcome))
    for boot in (0, 5, 5, 0):
        console.note_controller(boot, 2.0)
        assert console.requests[1].outcome is GaitOutcome.ACCEPTED
    console.note_controller(6, 3.0)
    assert console.requests[0].outcome is GaitOutcome.COMPLETED
    assert console.requests[1].outcome is GaitOutcome.ABORTED
    assert "restarted" in console.requests[1].describe(3.0)


def test_a_gait_without_an_answer_is_shown_as_such() -> None:
    desk = Desk(FakeController(answer=lambda *_: [])).type("w", run=0.5)
    assert "forward: asked" in desk.screen.text
    desk.bench.run(3.0)
    assert "forward: NO ANSWER for 4 s" in desk.screen.text


def test_keys_without_a_meaning_are_named() -> None:
    desk = Desk().type("ß")
    assert "'ß' does nothing" in desk.screen.text


@pytest.mark.parametrize("key", sorted(set(BY_KEY) - {"Esc", "Ctrl-c"}))
def test_no_key_ends_the_operator_or_makes_the_hands_jump(key: str) -> None:
    desk = Desk().type(key, key, run=0.5)
    assert desk.operator.exit_code is None
    hands = np.array(
        [
            [m.left_hand_position_in_body, m.right_hand_position_in_body]
            for m in desk.bench.messages(TELEOP_SETPOINT)
        ]
    )
    assert np.linalg.norm(np.diff(hands, axis=0), axis=2).max() <= 0.35 * 0.05 + 1e-9


def test_escape_or_a_lost_terminal_ends_it() -> None:
    assert Desk().type("Esc", run=0.1).operator.exit_code == 0
    desk = Desk()
    desk.screen.typed.append(None)
    desk.bench.run(0.1)
    assert desk.operator.exit_code == 0
    desk.operator.close()
    assert desk.screen.closed == 1
