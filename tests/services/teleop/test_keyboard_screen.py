"""What the keyboard operator watches and what its screen tells."""

import numpy as np

from common.robot.pose import Pose
from common.schemas import CameraFrame, GuardMode, Header, OperatorStatus
from common.topics import (
    CAMERA_LEFT,
    ESTOP,
    PLANT_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_STATE,
)
from services.teleop.keyboard.screen import HEIGHT
from services.teleop.keyboard.service import KeyboardOperator
from services.teleop.targets.targets import OperatorTargets
from tests.services.inputs import FakeInputs

from .desk import Desk, FakeScreen
from .support import Bench, controller_state, plant_status


def status(finished: bool = False) -> OperatorStatus:
    return OperatorStatus(script="demo", step=3, steps=9, label="reach", finished=finished)


def test_it_watches_while_a_script_runs_and_takes_over_without_a_jump() -> None:
    desk = Desk(settle=0.0)
    other = OperatorTargets()
    other.hands["left"].place(Pose(np.array([0.42, 0.2, 0.2]), other.hands["left"].quaternion))
    setpoint = other.setpoint(5).model_copy(update={"header": Header(source="teleop")})
    desk.bench.inputs.put(TELEOP_STATUS, status())
    desk.bench.inputs.put(TELEOP_SETPOINT, setpoint)
    desk.bench.run(2.0)
    desk.type("w", "i", "g", "h", run=0.2)
    assert desk.bench.messages(TELEOP_SETPOINT) == []
    assert desk.bench.messages(TELEOP_GAIT) == []
    assert "script      demo 3/9 reach" in desk.screen.text
    assert "not sent, the script 'demo' has the robot" in desk.screen.text
    desk.type("x", "x")
    assert len(desk.bench.messages(ESTOP)) == 1

    desk.bench.inputs.put(TELEOP_STATUS, status(finished=True))
    desk.bench.run(0.05)
    assert "taking over from teleop" in desk.screen.text
    np.testing.assert_allclose(desk.hand("left")[0], [0.42, 0.2, 0.2])
    desk.bench.run(2.0)
    np.testing.assert_allclose(desk.hand("left")[0], [0.42, 0.2, 0.2])


def test_it_listens_for_a_second_before_it_commands() -> None:
    desk = Desk(settle=0.9)
    assert desk.bench.messages(TELEOP_SETPOINT) == []
    desk.bench.run(0.3)
    assert len(desk.bench.messages(TELEOP_SETPOINT)) >= 1


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
    assert len(desk.screen.lines) <= HEIGHT
    desk.type("w", "a", "s", "d", run=0.2)
    assert len(desk.screen.lines) <= HEIGHT


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
