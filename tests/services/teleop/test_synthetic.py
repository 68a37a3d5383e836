"""The synthetic operator: what it sees, how it moves, how it plans; whole tasks in test_tasks."""

import math

import numpy as np
import pytest

from common.errors import ConfigError
from common.robot.pose import Pose, Pose2
from common.schemas import (
    AuthorityChange,
    ControlState,
    DeviceInput,
    Gait,
    GuardMode,
    Header,
    PlantState,
)
from common.schemas.arrays import Float64Array as Array
from common.topics import (
    PLANT_STATE,
    TELEOP_DEVICE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_TARGET,
)
from services.teleop.synthetic.observation import Observation, Observer
from services.teleop.synthetic.operator_hand import OperatorHand, Slips, Tremor
from services.teleop.synthetic.operator_model import OperatorModel
from services.teleop.synthetic.service import SyntheticConfig, SyntheticOperator
from services.teleop.synthetic.strategies import STRATEGIES, find_strategy
from services.teleop.synthetic.traits import TRAITS
from services.teleop.synthetic.walking import (
    STEPS,
    Tolerance,
    plan_gaits,
    rule_gait,
)
from services.teleop.targets.hand import minimum_jerk
from services.wbc.config import GaitConfig
from services.wbc.footsteps import gait_displacement
from tests.services.teleop.support import BOOT, Bench, FakeController, at_left, authority

STEADY = TRAITS["steady"]


def test_the_operator_has_learnt_what_the_gaits_do() -> None:
    for gait, step in STEPS.items():
        moved = (step.x, step.y, step.yaw)
        assert moved == pytest.approx(gait_displacement(gait, GaitConfig()))


@pytest.mark.parametrize("seed", range(12))
def test_planned_gaits_lead_to_the_goal_and_are_few(seed: int) -> None:
    rng = np.random.default_rng(seed)
    x, y, yaw = rng.normal((0.0, 0.0, 0.0), (0.1, 0.2, 0.2))
    here, goal = Pose2(x, y, yaw), Pose2(1.0, 0.0, 0.0)
    tolerance = Tolerance(0.05, math.radians(9.1))
    gaits = plan_gaits(here, goal, tolerance)
    for gait in gaits:
        here = here.then(STEPS[gait])
    assert tolerance.met(here, goal)
    assert 4 <= len(gaits) <= 12


def test_gaits_are_planned_where_two_ways_are_exactly_as_long() -> None:
    gaits = plan_gaits(Pose2(), Pose2(1.0, 0.0, 0.0), Tolerance())
    assert gaits == [Gait.FORWARD] * 5


def test_the_rule_turns_then_goes_ahead_then_aside() -> None:
    goal, tolerance = Pose2(0.4, 0.1, 0.0), Tolerance()
    here, done = Pose2(0.0, 0.0, 0.3), []
    while (gait := rule_gait(here, goal, tolerance)) is not None:
        done.append(gait)
        here = here.then(STEPS[gait])
    assert done == [Gait.TURN_RIGHT, Gait.FORWARD, Gait.FORWARD, Gait.SIDE_LEFT]


def test_a_reach_is_bell_shaped_and_arrives() -> None:
    rng = np.random.default_rng(0)
    own = OperatorHand("left", rng, 0.0, 0.0, Slips(rng, 0.0, 0.0, 0.0))
    start = own.position
    own.move(np.array([0.1, 0.0, 0.0]), np.zeros(3), 1.0)
    path = [start]
    while own.moving:
        own.advance(0.05)
        path.append(own.position)
    steps = np.diff(np.array(path)[:, 0])
    assert np.argmax(steps) in {9, 10}
    assert steps[0] < 0.1 * steps.max()
    np.testing.assert_allclose(own.position - start, [0.1, 0.0, 0.0])
    assert minimum_jerk(0.5) == pytest.approx(0.5)


def test_a_hand_that_is_knocked_off_its_way_comes_back() -> None:
    slips = Slips(np.random.default_rng(0), 0.5, 0.02, 0.1)
    offsets, away = [], []
    for _ in range(20 * 400):
        slips.advance(0.05, safe=True)
        offsets.append(slips.offset)
        away.append(slips.away)
    distance = np.linalg.norm(np.array(offsets)[:, :3], axis=1)
    ends = np.flatnonzero(np.diff(np.array(away, dtype=int)) < 0)
    # Every 2 s, and 0.85 s of each.
    assert len(ends) == pytest.approx(400 / 2.85, rel=0.2)
    assert np.array(offsets)[ends, :3].std() == pytest.approx(0.02, rel=0.15)
    assert np.array(offsets)[ends, 3:].std() == pytest.approx(0.1, rel=0.15)
    for end in ends[:-1]:
        # Off in five steps, and back in twelve.
        assert np.all(np.diff(distance[end - 5 : end + 1]) > 0.0)
        assert np.all(np.diff(distance[end : end + 13]) < 0.0)
        assert distance[end - 5] == distance[end + 12] == 0.0


def test_a_hand_is_not_knocked_while_it_grips_and_without_slips_nothing_is_drawn() -> None:
    slips = Slips(np.random.default_rng(0), 10.0, 0.02, 0.1)
    for _ in range(100):
        slips.advance(0.05, safe=False)
        assert not slips.away
        assert not slips.offset.any()
    rng = np.random.default_rng(5)
    quiet = Slips(rng, 0.0, 0.02, 0.1)
    quiet.advance(0.05, safe=True)
    assert rng.uniform() == np.random.default_rng(5).uniform()


def test_tremor_has_its_size_and_its_band() -> None:
    samples = np.array(
        [
            Tremor(np.random.default_rng(seed), 0.002, 3).at(0.05 * k)
            for seed in range(40)
            for k in range(100)
        ]
    )
    assert samples.std() == pytest.approx(0.002, rel=0.1)
    line = np.array([Tremor(np.random.default_rng(1), 1.0, 1).at(0.01 * k)[0] for k in range(4000)])
    power = np.abs(np.fft.rfft(line * np.hanning(line.size))) ** 2
    frequency = np.fft.rfftfreq(line.size, 0.01)
    inside = power[(frequency > 0.6) & (frequency < 9.5)].sum()
    assert inside > 0.999 * power.sum()


def observation(hand: Array | None = None, stamp: int = 0) -> Observation:
    flat = np.array([1.0, 0.0, 0.0, 0.0])
    there = np.array([0.3, 0.2, 0.0]) if hand is None else hand
    hands = {"left": Pose(there, flat), "right": Pose(np.array([0.3, -0.2, 0.0]), flat)}
    return Observation(stamp, Pose(np.zeros(3), flat), hands, balancing=True)


def reaching(delay: int) -> tuple[OperatorModel, list[Array], list[bool]]:
    """A reach of 20 cm by a hand that follows perfectly but is seen ``delay`` ticks late."""
    operator = OperatorModel(STEADY, np.random.default_rng(0), observation())
    goal = Pose(np.array([0.3, 0.4, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    offset = operator.seen.hands["left"].position - operator.own_hands["left"].position
    hands, moving = [operator.seen.hands["left"].position], []
    act = operator.reach("left", lambda _: goal, tolerance=0.01)
    for k in range(1, 400):
        late = hands[max(0, len(hands) - 1 - delay)]
        operator.perceive(observation(late, 50_000_000 * k), [], 0.05 * k, 0.05)
        if next(act, True):
            break
        operator.advance(0.05)
        hands.append(operator.own_hands["left"].position + offset)
        moving.append(operator.own_hands["left"].moving)
    return operator, hands, moving


def test_a_late_picture_makes_it_wait_but_not_miss() -> None:
    quick, hands, _ = reaching(0)
    slow, late_hands, moving = reaching(10)
    for operator, path in ((quick, hands), (slow, late_hands)):
        assert np.linalg.norm(path[-1] - [0.3, 0.4, 0.0]) < 0.012
        assert np.array(path)[:, 1].max() < 0.42, "it overshot: it did not wait for the picture"
        assert operator.time < 20.0
    assert slow.time >= quick.time + 0.45
    assert slow.lag > quick.lag + 0.1
    assert not all(moving)


def plant_state(resets: int = 0, stamp: int = 1_000_000_000, height: float = 0.8) -> PlantState:
    return PlantState(
        header=Header(stamp=stamp),
        base_position=np.array([0.0, 0.0, height]),
        base_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        base_linear_velocity=np.zeros(3),
        base_angular_velocity=np.zeros(3),
        joint_position=np.zeros(27),
        joint_velocity=np.zeros(27),
        joint_torque=np.zeros(27),
        gripper_closure=np.zeros(2),
        foot_normal_force=np.full(2, 200.0),
        reset_count=resets,
    )


class WalkBench(Bench):
    """A robot that stands where it is whatever it is asked."""

    def show(self, resets: int = 0) -> None:
        self.inputs.put(PLANT_STATE, plant_state(resets, self.now_ns))


def operator(**changes: object) -> SyntheticOperator:
    return SyntheticOperator(SyntheticConfig.model_validate({"task": "door/walk", **changes}))


def test_it_waits_for_balance_then_sends_devices_and_setpoints_at_20_hz() -> None:
    bench = WalkBench(operator(), FakeController(state=ControlState.STAND))
    bench.show()
    bench.run(1.0)
    assert bench.messages(TELEOP_DEVICE) == []
    bench.controller.state = ControlState.BALANCE
    bench.run(1.0)
    assert len(bench.messages(TELEOP_DEVICE)) == len(bench.messages(TELEOP_SETPOINT)) == 20
    device = bench.messages(TELEOP_DEVICE)[-1]
    assert isinstance(device, DeviceInput)
    assert device.device == "synthetic"


def test_what_it_does_not_see_it_says() -> None:
    bench = WalkBench(operator(task="door/walk"))
    bench.show()
    bench.run(3.0)
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    assert "expected to see 'goal'" in service.failure
    bench.run(3.0)
    assert service.exit_code == 1


def test_it_gives_up_when_the_robot_lies_down() -> None:
    bench = WalkBench(operator())
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    service._strategy = lambda operator: operator.pause(60.0)
    bench.show()
    bench.run(1.0)
    assert not service.failure
    bench.inputs.put(PLANT_STATE, plant_state(stamp=bench.now_ns, height=0.2))
    bench.run(3.0)
    assert "has fallen" in service.failure
    assert service.exit_code == 1


def test_a_person_who_takes_the_robot_interrupts_it_and_its_time_stands_still() -> None:
    bench = WalkBench(operator())
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    service._strategy = lambda operator: operator.pause(3.0)
    bench.show()
    bench.run(1.0)
    bench.controller.authority = authority("keyboard", 5, AuthorityChange.TAKEN, "teleop")
    bench.run(0.1)
    before = len(bench.messages(TELEOP_SETPOINT))
    bench.run(20.0)
    assert not service.finished
    assert len(bench.messages(TELEOP_SETPOINT)) == before
    assert service.note == "waiting: keyboard has the robot"
    bench.inputs.put(WBC_TARGET, at_left(0.42, 0.2, 0.2))
    bench.controller.authority = authority("operator", BOOT)
    bench.run(0.1)
    again = bench.messages(TELEOP_SETPOINT)[before].left_hand_position_in_body
    np.testing.assert_allclose(again, [0.42, 0.2, 0.2])
    bench.run(1.5)
    assert not service.finished
    bench.run(1.0)
    assert service.finished
    bench.run(2.0)
    assert service.exit_code == 0
    assert not bench.controller.claims[-1].wants


def test_an_emergency_stop_ends_its_plan() -> None:
    bench = WalkBench(operator())
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    service._strategy = lambda operator: operator.pause(60.0)
    bench.show()
    bench.run(1.0)
    state = plant_state(stamp=bench.now_ns).model_copy(update={"guard": GuardMode.ESTOP})
    bench.inputs.put(PLANT_STATE, state)
    bench.run(3.0)
    assert service.failure == "the emergency stop is on"
    assert service.exit_code == 1


def test_without_the_robot_it_does_not_begin_and_says_who_has_it() -> None:
    controller = FakeController(authority=authority("keyboard", 5))
    bench = WalkBench(operator(start_timeout=3.0), controller)
    bench.show()
    bench.run(2.0)
    assert bench.messages(TELEOP_DEVICE) == []
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    bench.run(2.0)
    assert service.failure == "not begun within 3 s: keyboard has the robot"
    assert service.exit_code == 1


@pytest.mark.parametrize("stay", [False, True])
def test_after_the_task_it_ends_well_or_stays(stay: bool) -> None:
    bench = WalkBench(operator(stay=stay))
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    service._strategy = lambda operator: operator.pause(1.0)
    bench.show()
    bench.run(5.0)
    assert service.finished
    assert service.exit_code == (None if stay else 0)


def test_a_reset_starts_a_new_trial() -> None:
    bench = WalkBench(operator(stay=True))
    bench.show()
    bench.run(2.0)
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    first = service.model
    assert first is not None
    bench.show(resets=1)
    bench.run(0.5)
    assert service.model is not None
    assert service.model is not first
    assert service.model.facing != first.facing


def test_a_gait_unanswered_is_asked_for_again() -> None:
    bench = WalkBench(operator(), FakeController(answer=lambda _request, _number: ()))
    bench.show()
    service = bench.service
    assert isinstance(service, SyntheticOperator)
    service._strategy = lambda operator: operator.gait(Gait.FORWARD, tries=3)
    bench.run(12.0)
    requests = bench.messages(TELEOP_GAIT)
    assert [request.gait for request in requests] == [Gait.FORWARD] * 3
    assert len({request.request_id for request in requests}) == 3
    assert "after 3 presses" in service.failure


def test_every_known_task_has_a_plan_and_others_are_told() -> None:
    assert set(STRATEGIES) >= {"door/walk", "door/unlock", "bench/hammer"}
    with pytest.raises(ConfigError, match=r"no strategy for 'door/open'.*door/unlock"):
        find_strategy("door/open")


def test_eyes_smooth_the_noise_of_the_torso() -> None:
    eyes, rng, seen = Observer(), np.random.default_rng(0), []
    for k in range(200):
        noisy = plant_state(stamp=k + 1).model_copy(
            update={"base_position": np.array([0.0, 0.0, 0.8]) + rng.normal(0.0, 0.002, 3)}
        )
        picture = eyes.observe(noisy, None, None)
        assert picture is not None
        seen.append(picture.torso.position)
    assert 0.0008 < np.array(seen)[20:].std(axis=0).max() < 0.0016
