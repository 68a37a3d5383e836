"""When the synthetic operator takes the robot over from another, and what it does until then."""

from dataclasses import replace

import numpy as np
import pytest

from common.robot.pose import Pose
from common.schemas import AuthorityChange
from common.topics import TELEOP_SETPOINT
from services.teleop.synthetic.observation import Observation
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator
from services.teleop.synthetic.take_over import StallWatch, TakeOver
from tests.services.teleop.support import BOOT, authority
from tests.services.teleop.test_synthetic import WalkBench, observation

DT = 0.05


def taken_over(seen: list[Observation], config: TakeOver) -> float | None:
    """Time after which the operator takes over [s]; None: it does not."""
    watch = StallWatch(config)
    for number, one in enumerate(seen, start=1):
        if watch.update(one, DT):
            return number * DT
    return None


def moving(until: float, end: float, balancing: bool = True) -> list[Observation]:
    """A hand that goes 4 cm/s until a time, then trembles by a millimetre [s]."""
    times = np.arange(0.0, end, DT)
    hands = [np.array([0.3 + 0.04 * min(t, until) + 0.001 * np.sin(9 * t), 0.2, 0]) for t in times]
    return [replace(observation(hand), balancing=balancing) for hand in hands]


def test_a_hand_that_stays_within_two_centimetres_stalls() -> None:
    found = taken_over(moving(2.0, 10.0), TakeOver(stalled=3.0))
    assert found == pytest.approx(5.0, abs=0.6)
    assert taken_over(moving(10.0, 10.0), TakeOver(stalled=3.0)) is None


def test_a_hand_that_turns_does_not_stall() -> None:
    turned = [
        replace(one, hands={side: Pose(hand.position, spin(0.3 * DT * n)) for side, hand in
                            one.hands.items()})
        for n, one in enumerate(moving(0.0, 10.0))
    ]  # fmt: skip
    assert taken_over(turned, TakeOver(stalled=3.0)) is None


def spin(angle: float) -> np.ndarray:
    return np.array([np.cos(angle / 2), 0.0, 0.0, np.sin(angle / 2)])


def test_a_robot_that_walks_is_left_alone() -> None:
    walking = moving(0.0, 10.0, balancing=False)
    assert taken_over(walking, TakeOver(stalled=3.0, latest=5.0)) is None
    late = taken_over(moving(10.0, 10.0), TakeOver(stalled=3.0, latest=5.0))
    assert late == pytest.approx(5.0, abs=0.1)


def test_it_watches_another_operator_then_takes_the_robot_by_an_act() -> None:
    config = SyntheticConfig(task="door/walk", take_over=TakeOver(stalled=1.0))
    bench = WalkBench(SyntheticOperator(config))
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    service._strategy = lambda operator: operator.pause(3.0)
    bench.show()
    bench.controller.grants = False
    bench.run(3.0)
    assert service.note == "watching for somebody to begin"
    assert not any(claim.wants for claim in bench.controller.claims)
    bench.controller.authority = authority("policy", 5)
    bench.run(0.8)
    assert service.note == "watching policy"
    bench.run(0.4)
    last = bench.controller.claims[-1]
    assert last.wants
    assert last.act > bench.controller.claims[0].act
    assert not bench.messages(TELEOP_SETPOINT)
    bench.controller.authority = authority("operator", BOOT, AuthorityChange.TAKEN, "policy")
    bench.run(1.0)
    assert len(bench.messages(TELEOP_SETPOINT)) > 15
