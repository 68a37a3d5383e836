import numpy as np
import pytest

from common.robot.rotations import rotation_between
from common.schemas import (
    AuthorityChange,
    ControlState,
    Gait,
    GaitOutcome,
    GuardMode,
    OperatorKind,
    OperatorStatus,
    Setpoint,
)
from common.topics import PLANT_STATUS, TELEOP_GAIT, TELEOP_SETPOINT, WBC_STATE, WBC_TARGET
from services.teleop.scripted.library import SCRIPTS, ScriptOptions
from services.teleop.scripted.script import (
    Grip,
    HandPose,
    Mark,
    Move,
    Neck,
    Sine,
    Together,
    Wait,
    Walk,
)
from services.teleop.scripted.service import LABEL_WAITING, ScriptedOperator
from services.teleop.targets.hand import hand_quaternion

from .scripts import bench, last_status, left, operator, scripted
from .support import (
    BOOT,
    Bench,
    FakeController,
    at_left,
    authority,
    controller_state,
    plant_status,
)

A, R, C, X = (GaitOutcome.ACCEPTED, GaitOutcome.REFUSED, GaitOutcome.COMPLETED, GaitOutcome.ABORTED)


def test_setpoints_go_out_every_tick_and_a_second_longer_than_the_script() -> None:
    b = bench(Wait(seconds=0.5)).run(10)
    times = b.times(TELEOP_SETPOINT)
    assert set(np.diff(times)) == {50_000_000}
    assert b.service.exit_code == 0
    # One tick to start, 0.5 s of waiting, 1 s of lingering.
    assert (times[-1] - times[0]) * 1e-9 == pytest.approx(1.6, abs=0.051)
    stamps = {message.header.stamp for message in b.messages(TELEOP_SETPOINT)}
    assert stamps == {123}


def test_nothing_starts_before_the_controller_balances() -> None:
    b = bench(Walk(gait=Gait.FORWARD), controller=FakeController(state=ControlState.STAND))
    b.run(2)
    assert b.messages(TELEOP_GAIT) == []
    assert last_status(b).label == LABEL_WAITING
    b.controller.state = ControlState.BALANCE
    b.run(5)
    assert b.service.exit_code == 0
    assert len(b.messages(TELEOP_GAIT)) == 1


def test_a_controller_that_never_balances_fails_the_script() -> None:
    b = Bench(
        operator(Wait(seconds=1), start_timeout=3.0), FakeController(state=ControlState.STAND)
    )
    b.run(10)
    assert b.service.exit_code == 1
    assert "did not balance within 3 s; last seen: STAND" in scripted(b).failure


def test_move_reaches_the_pose_along_a_minimum_jerk_path() -> None:
    pose = HandPose(position=(0.40, 0.20, 0.10), rotation=(0.1, 0.2, -0.1))
    b = bench(Move(left=pose, duration=2.0)).run(10)
    end = b.messages(TELEOP_SETPOINT)[-1]
    assert isinstance(end, Setpoint)
    np.testing.assert_allclose(end.left_hand_position_in_body, [0.40, 0.20, 0.10], atol=1e-9)
    assert np.linalg.norm(
        rotation_between(end.left_hand_quaternion_in_body, hand_quaternion(0.1, 0.2, -0.1))
    ) == pytest.approx(0.0, abs=1e-9)
    # Half the way at half the time, and slow at both ends.
    x = np.array([m.left_hand_position_in_body[0] for m in b.messages(TELEOP_SETPOINT)])
    share = (x - x[0]) / (x[-1] - x[0])
    started = int(np.argmax(share > 0)) - 1
    assert share[started + 20] == pytest.approx(0.5, abs=1e-6)
    assert share[started + 2] < 0.01


def test_a_move_asked_too_fast_takes_longer_and_stays_within_the_speed() -> None:
    pose = left(0.5, 0.0, 0.4)
    b = bench(Move(left=pose, duration=0.1)).run(10)
    p = np.array([m.left_hand_position_in_body for m in b.messages(TELEOP_SETPOINT)])
    speed = np.linalg.norm(np.diff(p, axis=0), axis=1) / 0.05
    assert 0.3 < speed.max() <= 0.35
    np.testing.assert_allclose(p[-1], pose.position, atol=1e-9)


def test_sine_swings_by_its_amplitude_and_ends_where_it_began() -> None:
    swing = Sine(hand="right", axis="z", amplitude=0.05, frequency=0.5, duration=6.0)
    b = bench(swing).run(10)
    z = np.array([m.right_hand_position_in_body[2] for m in b.messages(TELEOP_SETPOINT)])
    assert z.max() - z[0] == pytest.approx(0.05, abs=1e-3)
    assert z.min() - z[0] == pytest.approx(-0.05, abs=1e-3)
    assert z[-1] == pytest.approx(z[0], abs=1e-9)
    y = np.array([m.left_hand_position_in_body for m in b.messages(TELEOP_SETPOINT)])
    assert np.ptp(y, axis=0).max() == 0.0


def test_grippers_and_neck_ramp_and_are_waited_for() -> None:
    b = bench(Grip(left=1.0), Neck(pitch=0.3), Grip(left=0.25, right=0.5)).run(10)
    messages = b.messages(TELEOP_SETPOINT)
    closure = np.array([m.gripper_closure for m in messages])
    neck = np.array([m.neck_pitch for m in messages])
    assert np.abs(np.diff(closure, axis=0)).max() == pytest.approx(0.1)
    np.testing.assert_allclose(closure[-1], [0.25, 0.5])
    assert neck[-1] == pytest.approx(0.3)
    assert closure[neck > 0][0][0] == 1.0
    assert closure[:, 1][neck < 0.29].max() == 0.0


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"fallen": True}, "the robot has fallen"),
        ({"guard": GuardMode.ESTOP}, "the emergency stop is on"),
    ],
)
def test_a_fall_or_emergency_stop_fails_the_script(change: dict[str, bool], reason: str) -> None:
    b = bench(Wait(seconds=5))
    b.run(1)
    b.inputs.put(PLANT_STATUS, plant_status(**change))
    b.run(5)
    assert b.service.exit_code == 1
    assert scripted(b).failure == f"step 1/1: {reason}"


@pytest.mark.parametrize(
    ("change", "reason"),
    [({"fallen": True}, "the robot has fallen"), ({"guard": GuardMode.ESTOP}, "emergency stop")],
)
def test_a_script_that_finds_a_robot_unfit_says_so_and_ends(
    change: dict[str, bool], reason: str
) -> None:
    b = bench(Walk(gait=Gait.FORWARD))
    b.inputs.put(PLANT_STATUS, plant_status(**change))
    b.run(1)
    assert reason in last_status(b).label
    b.run(6)
    assert b.service.exit_code == 1
    assert reason in scripted(b).failure
    assert "trill reset" in scripted(b).failure
    assert b.messages(TELEOP_GAIT) == []


def test_a_robot_that_is_stood_up_in_time_is_used() -> None:
    b = bench(Wait(seconds=0.1))
    b.inputs.put(PLANT_STATUS, plant_status(fallen=True))
    b.run(4)
    b.inputs.put(PLANT_STATUS, plant_status())
    assert b.run(4).service.exit_code == 0


def test_a_script_claims_starts_at_the_present_target_and_gives_the_robot_back() -> None:
    controller = FakeController(grants=False)
    b = bench(Move(left=left(0.4, 0.2, 0.1), duration=1.0), controller=controller)
    b.inputs.put(WBC_TARGET, at_left(0.42, 0.2, 0.2))
    b.run(2)
    assert b.messages(TELEOP_SETPOINT) == []
    first = controller.claims[0]
    assert (first.kind, first.wants, first.act, first.holding) == (
        *(OperatorKind.SCRIPT, True, 1, False),
    )
    assert "waiting for the robot" in last_status(b).label
    controller.grants = True
    b.run(5)
    start = b.messages(TELEOP_SETPOINT)[0].left_hand_position_in_body
    assert np.linalg.norm(start - [0.42, 0.2, 0.2]) < 1e-3
    assert b.service.exit_code == 0
    assert not controller.claims[-1].wants


def test_a_person_who_takes_the_robot_pauses_the_script() -> None:
    b = bench(Walk(gait=Gait.FORWARD), Move(left=left(0.4, 0.2, 0.1), duration=2.0))
    b.run(2.5)
    where = b.messages(TELEOP_SETPOINT)[-1].left_hand_position_in_body
    b.controller.authority = authority("keyboard", 5, AuthorityChange.TAKEN, "operator")
    b.run(1)
    before = len(b.messages(TELEOP_SETPOINT))
    b.run(20)
    assert len(b.messages(TELEOP_SETPOINT)) == before
    assert b.controller.claims[-1].wants
    assert not b.controller.claims[-1].holding
    assert last_status(b).label == "paused: keyboard has the robot"
    b.controller.authority = authority("operator", BOOT, AuthorityChange.GRANTED, "keyboard")
    b.run(5)
    again = b.messages(TELEOP_SETPOINT)[before].left_hand_position_in_body
    assert np.linalg.norm(again - where) < 0.02
    assert b.service.exit_code == 0
    assert len(b.messages(TELEOP_GAIT)) == 1


def test_a_reply_that_comes_while_a_person_has_the_robot_is_not_lost() -> None:
    b = bench(Walk(gait=Gait.FORWARD), controller=FakeController(gait_seconds=2.0))
    b.run(1)
    b.controller.authority = authority("keyboard", 5, AuthorityChange.TAKEN, "operator")
    b.run(10)
    assert b.service.exit_code is None
    b.controller.authority = authority("operator", BOOT)
    b.run(1.5)
    assert b.service.exit_code == 0
    assert len(b.messages(TELEOP_GAIT)) == 1


def test_a_script_that_never_gets_the_robot_names_who_has_it() -> None:
    controller = FakeController(authority=authority("keyboard", 5))
    b = Bench(operator(Wait(seconds=1), start_timeout=3.0), controller).run(10)
    assert b.service.exit_code == 1
    assert "within 3 s: keyboard has the robot" in scripted(b).failure


def test_a_silent_controller_fails_the_script() -> None:
    b = bench(Wait(seconds=60)).run(1)
    b.inputs.put(WBC_STATE, controller_state(), age=3.5)
    b.service.step(b.inputs, b.now_ns + 50_000_000)
    assert scripted(b).failure == "step 1/1: the controller has been silent for 3.5 s"


def test_the_script_waits_while_the_plant_is_paused() -> None:
    b = bench(Move(left=left(0.4, 0.2, 0.1), duration=2.0))
    b.run(1.5)
    b.inputs.put(PLANT_STATUS, plant_status(paused=True))
    before = b.messages(TELEOP_SETPOINT)[-1].left_hand_position_in_body
    b.run(5)
    np.testing.assert_array_equal(
        b.messages(TELEOP_SETPOINT)[-1].left_hand_position_in_body, before
    )
    b.inputs.put(PLANT_STATUS, plant_status())
    b.run(5)
    assert b.service.exit_code == 0
    np.testing.assert_allclose(
        b.messages(TELEOP_SETPOINT)[-1].left_hand_position_in_body, [0.4, 0.2, 0.1], atol=1e-9
    )


def test_a_late_step_moves_the_hands_no_further_than_a_tenth_of_a_second() -> None:
    b = bench(Move(left=left(0.5, 0.281, 0.046), duration=0.1))
    b.run(0.5)
    before = b.messages(TELEOP_SETPOINT)[-1].left_hand_position_in_body
    b.tick(1_000_000_000)
    after = b.messages(TELEOP_SETPOINT)[-1].left_hand_position_in_body
    assert np.linalg.norm(after - before) <= 0.035 + 1e-12


def test_lanes_run_side_by_side_and_the_longest_decides() -> None:
    b = bench(
        Together(
            lanes=(
                (Walk(gait=Gait.FORWARD, count=2),),
                (Move(left=left(0.4, 0.2, 0.1), duration=1.0), Grip(left=1.0)),
                (Neck(pitch=0.2), Mark(label="looking down")),
            )
        ),
        Mark(label="after"),
        controller=FakeController(gait_seconds=2.0),
    ).run(20)
    statuses = [(time, m) for (time, o) in b.sent if isinstance(m := o.message, OperatorStatus)]
    labels = list(dict.fromkeys(m.label for _, m in statuses))
    assert labels[-3:] == ["", "looking down", "after"]
    moved = [
        time
        for time, o in b.sent
        if isinstance(o.message, Setpoint) and o.message.left_hand_position_in_body[0] > 0.32
    ]
    requests = b.times(TELEOP_GAIT)
    assert moved[0] < requests[1]
    after = next(time for time, m in statuses if m.label == "after")
    assert after >= requests[1] + 2_000_000_000
    assert b.service.exit_code == 0


def test_status_counts_steps_at_five_hertz() -> None:
    b = bench(Wait(seconds=1), Mark(label="half"), Wait(seconds=1)).run(10)
    end = last_status(b)
    assert (end.script, end.step, end.steps, end.label) == ("t", 3, 3, "half")
    assert end.finished
    assert end.failed == ""
    waiting = [t for t, o in b.sent if isinstance(o.message, OperatorStatus)]
    assert np.diff(waiting).max() == 200_000_000


@pytest.mark.parametrize("name", list(SCRIPTS))
def test_built_in_scripts_end_well_and_never_jump(name: str) -> None:
    b = Bench(
        ScriptedOperator(SCRIPTS[name](ScriptOptions(count=3))), FakeController(gait_seconds=3.35)
    ).run(120)
    assert b.service.exit_code == 0
    hands = np.array(
        [
            [m.left_hand_position_in_body, m.right_hand_position_in_body]
            for m in b.messages(TELEOP_SETPOINT)
        ]
    )
    speed = np.linalg.norm(np.diff(hands, axis=0), axis=2) / 0.05
    assert speed.max() <= 0.35 + 1e-9
    if name == "demo":
        assert 60.0 <= len(hands) * 0.05 <= 75.0
