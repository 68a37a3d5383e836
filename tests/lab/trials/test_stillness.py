"""How long a trial stood still, from its set-points."""

from collections.abc import Callable
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from common.robot.kinematics import FORWARD_HAND
from common.schemas import Gait, Setpoint
from lab.trials.stillness import Stillness


class Trial:
    """Stands in for a trial: its set-points and the controller's gait are given."""

    def __init__(self) -> None:
        self.over = False
        self.gait = Gait.NONE
        self.runner = self
        self.send: Callable[[Setpoint], None] = lambda _: None
        self.stillness = Stillness(cast(Any, self))

    def newest(self, _topic: object) -> Callable[[], SimpleNamespace]:
        return lambda: SimpleNamespace(gait=self.gait)

    def on_message(self, _topic: object, callback: Callable[[Setpoint], None]) -> None:
        self.send = callback

    def hold(self, frames: int, x: float = 0.3, closure: float = 0.0) -> None:
        for _ in range(frames):
            self.send(
                Setpoint(
                    left_hand_position_in_body=np.array([x, 0.2, 0.1]),
                    left_hand_quaternion_in_body=FORWARD_HAND,
                    right_hand_position_in_body=np.array([0.3, -0.2, 0.1]),
                    right_hand_quaternion_in_body=FORWARD_HAND,
                    gripper_closure=np.array([closure, 0.0]),
                )
            )


def test_a_hand_that_rests_is_still_and_one_that_creeps_too() -> None:
    trial = Trial()
    assert trial.stillness.seconds == 0.0
    trial.hold(20)
    for i in range(20):
        trial.hold(1, x=0.3 + 0.001 * i)
    # 1 mm a frame is 2 cm/s.
    assert trial.stillness.seconds == pytest.approx(2.0)


def test_a_hand_or_gripper_that_moves_is_not() -> None:
    trial = Trial()
    for i in range(40):
        trial.hold(1, x=0.3 + 0.002 * i)
    # 2 mm a frame is 4 cm/s; the first frames have not moved yet.
    assert trial.stillness.seconds == pytest.approx(5 * 0.05)
    trial.hold(6, x=0.378, closure=1.0)
    assert trial.stillness.seconds == pytest.approx(5 * 0.05)


def test_neither_a_gait_nor_what_comes_after_the_verdict_counts() -> None:
    trial = Trial()
    trial.gait = Gait.FORWARD
    trial.hold(20)
    trial.gait, trial.over = Gait.NONE, True
    trial.hold(20)
    assert trial.stillness.seconds == 0.0
