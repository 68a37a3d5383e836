"""Who has the robot at the keyboard, its emergency stop, and what its screen tells."""

import re

import numpy as np
import pytest

from common.estop import BURST
from common.schemas import (
    AuthorityChange,
    CameraFrame,
    GuardMode,
    Header,
    OperatorStatus,
    PlantStatus,
)
from common.topics import (
    CAMERA_LEFT,
    ESTOP,
    ESTOP_CLEAR,
    PLANT_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_STATE,
    WBC_TARGET,
)
from services.teleop.keyboard.keymap import BY_KEY
from services.teleop.keyboard.screen import HEIGHT, WIDTH
from services.teleop.keyboard.service import KeyboardOperator
from tests.services.inputs import FakeInputs

from .desk import Desk, FakeScreen
from .support import (
    BOOT,
    NOBODY,
    Bench,
    FakeController,
    at_left,
    authority,
    controller_state,
    plant_status,
)


def holder(desk: Desk, name: str, boot: int = 5) -> None:
    """Let another operator take the robot."""
    desk.bench.controller.authority = authority(name, boot, AuthorityChange.TAKEN, "operator")
    desk.bench.run(0.05)


def latched(**changes: object) -> PlantStatus:
    stopped = {"guard": GuardMode.ESTOP, "stops": 3, "stopped_by": "cli", "stop_reason": "smoke"}
    return plant_status(**(stopped | changes))


def acts(desk: Desk) -> int:
    return desk.bench.controller.claims[-1].act


def test_while_another_has_the_robot_moving_keys_say_so_and_do_nothing() -> None:
    desk = Desk(take=False)
    desk.bench.controller.authority = authority("teleop", 5, waiting=["policy"])
    desk.bench.inputs.put(
        TELEOP_STATUS, OperatorStatus(script="demo", step=3, steps=9, label="reach", finished=False)
    )
    desk.bench.run(2.0)
    desk.type("w", "i", "g", "h", run=0.2)
    assert desk.bench.messages(TELEOP_SETPOINT) == []
    assert desk.bench.messages(TELEOP_GAIT) == []
    assert acts(desk) == 0
    assert "teleop has it" in desk.screen.text
    assert "waiting: policy" in desk.screen.text
    assert "script      demo 3/9 reach" in desk.screen.text
    assert "not sent, teleop has the robot; Enter takes it" in desk.screen.text


def test_the_key_takes_the_robot_from_a_script_and_starts_at_the_present_target() -> None:
    desk = Desk(take=False)
    desk.bench.controller.authority = authority("teleop", 5)
    desk.bench.inputs.put(WBC_TARGET, at_left(0.42, 0.2, 0.2))
    desk.bench.run(0.5)
    desk.type("Enter", run=0.0)
    assert acts(desk) == 1
    assert desk.bench.messages(TELEOP_SETPOINT) == []
    desk.bench.controller.authority = authority("operator", BOOT, AuthorityChange.TAKEN, "teleop")
    desk.bench.run(1.0)
    assert len(desk.bench.messages(TELEOP_SETPOINT)) == 20
    for message in desk.bench.messages(TELEOP_SETPOINT):
        np.testing.assert_array_equal(message.left_hand_position_in_body, [0.42, 0.2, 0.2])
    assert "YOU have it" in desk.screen.text
    assert "taken from teleop" in desk.screen.text


def test_a_moving_key_takes_a_free_robot_and_then_takes_effect() -> None:
    desk = Desk(take=False)
    desk.bench.inputs.put(WBC_TARGET, at_left(0.40, 0.2, 0.1))
    desk.bench.controller.grants = False
    desk.type("i", "w", run=0.5)
    assert acts(desk) == 1
    assert desk.bench.messages(TELEOP_GAIT) == []
    assert desk.bench.messages(TELEOP_SETPOINT) == []
    desk.bench.controller.grants = True
    desk.bench.run(3.0)
    np.testing.assert_allclose(desk.hand("left")[0], [0.42, 0.2, 0.1], atol=2e-4)
    assert len(desk.bench.messages(TELEOP_GAIT)) == 1


def test_keys_that_were_not_granted_are_forgotten() -> None:
    desk = Desk(FakeController(grants=False), take=False)
    desk.type("w", run=3.5)
    assert "not given to you: nobody has the robot" in desk.screen.text
    assert not desk.bench.controller.claims[-1].wants
    desk.bench.controller.grants = True
    desk.type("Enter", run=0.5)
    assert desk.bench.messages(TELEOP_SETPOINT) != []
    assert desk.bench.messages(TELEOP_GAIT) == []


def test_without_a_controller_no_key_asks_for_the_robot() -> None:
    desk = Desk(take=False)
    desk.operator.console.claimant.authority = None
    assert desk.operator.console.press("w", 0.0, 0) == []
    assert "the controller has not said who has the robot" in desk.operator.console.notice
    assert not desk.operator.console.claimant.wants


def test_a_second_keyboard_takes_over_and_the_first_is_told() -> None:
    desk = Desk()
    before = len(desk.bench.messages(TELEOP_SETPOINT))
    holder(desk, "keyboard")
    desk.bench.run(1.0)
    assert len(desk.bench.messages(TELEOP_SETPOINT)) == before
    assert "another keyboard has it" in desk.screen.text
    assert "you no longer have it: another keyboard has the robot" in desk.screen.text
    assert not desk.bench.controller.claims[-1].wants


def test_the_key_gives_the_robot_back_and_leaving_does_not() -> None:
    desk = Desk().type("Enter", run=0.2)
    assert "given back" in desk.screen.text
    assert not desk.bench.controller.claims[-1].wants
    assert "nobody has it" in desk.screen.text
    before = len(desk.bench.messages(TELEOP_SETPOINT))
    desk.bench.run(0.5)
    assert len(desk.bench.messages(TELEOP_SETPOINT)) == before
    desk = Desk().type("Esc", run=0.2)
    assert desk.operator.exit_code == 0
    assert desk.bench.controller.claims[-1].wants


@pytest.mark.parametrize("take", [True, False])
@pytest.mark.parametrize("key", ["x", "X", "ч", "Backspace", "Delete"])
def test_one_press_stops_until_the_plant_confirms(key: str, take: bool) -> None:
    desk = Desk(take=take).type(key, run=1.0)
    stops = [stop for stop in desk.bench.messages(ESTOP) if stop.pressed]
    assert len(stops) >= 20 * BURST
    assert "STOP SENT, NOT CONFIRMED for 1.0 s" in desk.screen.text
    desk.bench.inputs.put(PLANT_STATUS, latched())
    desk.bench.run(0.05)
    count = len(desk.bench.messages(ESTOP))
    desk.bench.run(1.0)
    after = desk.bench.messages(ESTOP)[count:]
    assert 9 <= len(after) <= 10
    assert not any(stop.pressed for stop in after)
    assert "STOPPED by cli: smoke - b b ends the stop" in desk.screen.text


def test_a_stop_takes_the_robot_away_and_only_a_new_key_after_its_end_brings_it_back() -> None:
    desk = Desk()
    desk.bench.inputs.put(PLANT_STATUS, latched())
    before = len(desk.bench.messages(TELEOP_SETPOINT))
    desk.bench.run(0.5)
    assert "the stop took the robot from you" in desk.screen.text
    desk.type("i", "w", "Enter", "x", run=0.2)
    assert acts(desk) == 1
    assert desk.bench.messages(ESTOP_CLEAR) == []
    desk.type("b", "b", run=0.0)
    (clear,) = desk.bench.messages(ESTOP_CLEAR)
    assert clear.stops == 3
    desk.bench.controller.authority = NOBODY
    desk.bench.inputs.put(PLANT_STATUS, plant_status())
    desk.bench.run(0.5)
    assert len(desk.bench.messages(TELEOP_SETPOINT)) == before
    desk.type("Enter", run=0.2)
    assert acts(desk) == 2
    assert len(desk.bench.messages(TELEOP_SETPOINT)) > before


def test_nothing_but_the_clear_key_ends_a_stop() -> None:
    desk = Desk()
    desk.bench.inputs.put(PLANT_STATUS, latched())
    desk.bench.run(0.1)
    for key in sorted(set(BY_KEY) - {"b"}):
        desk.type(key, key, run=0.1)
    assert desk.bench.messages(ESTOP_CLEAR) == []


def test_without_a_stop_the_clear_key_clears_nothing() -> None:
    desk = Desk().type("b", "b")
    assert desk.bench.messages(ESTOP_CLEAR) == []
    assert "no stop to end" in desk.screen.text


def test_leaving_waits_for_the_confirmation_of_a_stop() -> None:
    desk = Desk().type("x", "Esc", run=0.5)
    assert desk.operator.exit_code is None
    desk.bench.inputs.put(PLANT_STATUS, latched())
    desk.bench.run(0.1)
    assert desk.operator.exit_code == 0
    alone = Desk().type("x", "Esc", run=1.5)
    assert alone.operator.exit_code is None
    alone.bench.run(1.0)
    assert alone.operator.exit_code == 0


def test_the_screen_tells_state_ages_and_falls_and_fits() -> None:
    desk = Desk()
    inputs = desk.bench.inputs
    inputs.put(PLANT_STATUS, plant_status(fallen=True, guard=GuardMode.DAMP), age=0.12)
    desk.bench.run(0.1)
    inputs.put(PLANT_STATUS, plant_status(), age=0.12)
    desk.bench.run(0.1)
    assert "BALANCE" in desk.screen.text
    assert "falls 1" in desk.screen.text
    assert "torque from state 4/9 ms old" in desk.screen.text
    assert "120 ms ago" in desk.screen.text
    desk.type("w", "a", "s", "d", run=0.2)
    inputs.put(PLANT_STATUS, latched(stop_reason="r" * 200))
    waiting = [f"operator-{number}" for number in range(20)]
    desk.bench.controller.authority = authority("o" * 64, 5, waiting=waiting)
    desk.bench.run(0.1)
    assert len(desk.screen.lines) == HEIGHT
    assert max(len(re.sub(r"\x1b\[[0-9;]*m", "", line)) for line in desk.screen.lines) <= WIDTH


def test_the_screen_tells_how_far_behind_the_eyes_are() -> None:
    desk = Desk()
    assert "behind" not in desk.screen.text
    late = controller_state()
    stamp = late.header.stamp + 250_000_000
    picture = CameraFrame(
        header=late.header, eye="left", width=2, height=1, encoding="rgb8", data=bytes(6)
    )
    feedback = {
        CAMERA_LEFT: picture,
        WBC_STATE: late.model_copy(update={"header": Header(stamp=stamp)}),
    }
    inputs = FakeInputs()
    for topic, message in feedback.items():
        inputs.put(topic, message)
    desk.operator.step(inputs, 10_000_000_000)
    assert "sees 250 ms behind" in desk.screen.text
    inputs.put(CAMERA_LEFT, picture, age=0.6)
    desk.operator.step(inputs, 10_050_000_000)
    assert "behind" not in desk.screen.text


def test_without_a_robot_the_screen_says_so() -> None:
    screen = FakeScreen()
    operator = KeyboardOperator(screen)
    bench = Bench(operator)
    bench.inputs.messages.clear()
    bench.inputs.ages.clear()
    operator.step(bench.inputs, 10)
    assert screen.text.count("never heard") == 2
    assert "no controller has said who has it" in screen.text
