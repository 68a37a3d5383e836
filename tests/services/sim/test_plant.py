"""The plant as a whole: it stands, holds, sinks, gets pushed, is reset; always the same way."""

from typing import Any

import numpy as np
import pytest

from common.plant.config import TorqueMode
from common.plant.guard import Refusal
from common.plant.stop import StopRecord
from common.robot.joints import JOINT_INDEX
from common.schemas import GuardMode, Header, JointCommand
from services.sim.config import TYPICAL_NOISE, SimConfig
from services.sim.errors import PlantDivergedError
from services.sim.physics.plant import START_NS, Plant

from .support import MS, Stander, make_command, run_silently, state_bytes

MODES = list(TorqueMode)
WEIGHT = 36.522 * 9.81


def mode(robot: Plant) -> GuardMode:
    return robot.guard.mode


def plant(**settings: Any) -> Plant:
    return Plant(SimConfig(**settings))


@pytest.mark.parametrize("torques", MODES)
def test_stands_before_any_command(torques: TorqueMode) -> None:
    robot = plant(torque_mode=torques)
    start = robot.truth()
    run_silently(robot, 2.0)
    end = robot.truth()
    assert mode(robot) is GuardMode.SILENT
    assert robot.com()[2] == pytest.approx(
        {"relaxed": 0.70, "rated": 0.73}[torques.value], abs=1e-3
    )
    assert np.abs(end.base_position - start.base_position).max() < 1e-3
    assert np.abs(end.joint_position - start.joint_position).max() < 1e-3
    assert np.abs(end.joint_velocity).max() < 5e-3
    assert end.foot_normal_force.sum() == pytest.approx(WEIGHT, rel=0.01)
    assert end.foot_normal_force[0] == pytest.approx(end.foot_normal_force[1], rel=0.02)
    assert robot.saturated_fraction == 0.0
    assert not robot.fallen


@pytest.mark.parametrize("torques", MODES)
def test_holds_for_3_s_after_the_controller_falls_silent(torques: TorqueMode) -> None:
    robot = plant(torque_mode=torques)
    stander = Stander(robot)
    robot.push(np.array([30.0, 10.0, 0.0]), 0.1)
    stander.run(robot, 0.3)
    assert mode(robot) is GuardMode.ACTIVE
    moved = robot.truth()
    run_silently(robot, 3.0)
    held = robot.truth()
    assert mode(robot) is GuardMode.HOLD
    assert robot.guard.holds == 1
    assert not robot.fallen
    assert np.abs(held.joint_position - moved.joint_position).max() < 0.06
    assert abs(held.base_position[2] - moved.base_position[2]) < 0.01


def test_sinks_damped_when_silence_lasts_and_is_then_fallen() -> None:
    robot = plant(guard={"hold_after": 0.1, "damp_after": 0.5})
    Stander(robot).run(robot, 0.1)
    run_silently(robot, 0.5)
    assert mode(robot) is GuardMode.DAMP
    run_silently(robot, 1.5)
    assert robot.fallen
    assert robot.truth().base_position[2] < 0.5
    assert not robot.offer(make_command(robot.now_ns))
    run_silently(robot, 1.0)
    assert np.abs(robot.truth().joint_velocity).max() < 0.5, "limp, not flailing"


def test_returning_from_hold_does_not_jump() -> None:
    robot = plant()
    stander = Stander(robot)
    stander.run(robot, 0.2)
    run_silently(robot, 0.5)
    assert mode(robot) is GuardMode.HOLD
    before = robot.truth()
    stander.run(robot, 0.5)
    assert mode(robot) is GuardMode.ACTIVE
    assert np.abs(robot.truth().joint_position - before.joint_position).max() < 0.01


@pytest.mark.parametrize(
    "garbage",
    [
        {"position": np.full(27, np.nan)},
        {"torque": np.full(27, 1e6)},
        {"stiffness": np.full(27, -100.0)},
        {"velocity": np.full(27, np.inf)},
        {"header": Header(stamp=10**15)},
        {"header": Header(stamp=0)},
    ],
)
def test_garbage_between_sound_commands_leaves_the_robot_standing(garbage: Any) -> None:
    robot = plant()
    stander = Stander(robot)
    start = robot.truth()
    for _ in range(20):
        stander.run(robot, 0.02)
        assert not robot.offer(make_command(robot.now_ns, **garbage))
    assert robot.guard.refused == 20
    assert mode(robot) is GuardMode.ACTIVE
    assert np.abs(robot.truth().joint_position - start.joint_position).max() < 2e-3
    assert not robot.fallen


def test_commands_move_joints_and_grippers() -> None:
    robot = plant()
    stander = Stander(robot)
    wish = robot.truth().joint_position.copy()
    for i in range(800):
        # A step of 0.4 rad would be refused from a robot that is just being taken over.
        wish[-1] = min(0.4, 1e-3 * i)
        if i % 10 == 0:
            command = stander.command(robot.truth())
            robot.offer(
                command.model_copy(
                    update={"position": wish, "gripper_closure": np.array([1.0, 0.5])}
                )
            )
        robot.step()
    state = robot.truth()
    # The head's own weight of 1.2 kg keeps the neck (20 N·m/rad) a little off.
    assert state.joint_position[-1] == pytest.approx(0.4, abs=0.05)
    assert state.gripper_closure == pytest.approx([1.0, 0.5], abs=0.01)
    force = robot.data.actuator_force[robot.addresses.grippers]
    assert force == pytest.approx([-60.0, 0.0], abs=3.0), "a closed hand squeezes"


def test_a_push_has_the_impulse_asked_for() -> None:
    robot = plant()
    pushed = plant()
    pushed.push(np.array([0.0, 50.0, 0.0]), 0.05)
    for _ in range(50):
        robot.step()
        pushed.step()
        assert pushed.data.xfrc_applied[pushed.addresses.torso, 1] == 50.0 or pushed.steps == 50
    assert pushed.data.xfrc_applied[pushed.addresses.torso, 1] == 0.0
    moved = pushed.truth().base_linear_velocity - robot.truth().base_linear_velocity
    assert 0.01 < moved[1] < 0.2
    assert abs(moved[0]) < 0.2 * moved[1]


def test_a_hard_push_makes_it_fall_and_limp() -> None:
    robot = plant()
    robot.push(np.array([0.0, 400.0, 0.0]), 0.3)
    run_silently(robot, 2.0)
    assert robot.fallen
    assert mode(robot) is GuardMode.DAMP


def test_a_stop_goes_limp_at_once_and_no_reset_ends_it() -> None:
    robot = plant()
    stander = Stander(robot)
    stander.run(robot, 0.1)
    robot.guard.estop("keyboard", "smoke")
    robot.step()
    state = robot.truth()
    assert np.abs(state.joint_torque).max() < 1.0, "standing still, damping has no torque"
    assert state.guard is GuardMode.ESTOP
    assert not robot.offer(stander.command(state))
    run_silently(robot, 1.0)
    assert robot.truth().fallen
    robot.reset()
    assert not robot.fallen, "the pose is reset"
    robot.step()
    assert np.abs(robot.truth().joint_torque).max() < 1.0
    assert mode(robot) is GuardMode.ESTOP
    assert robot.guard.clear(1, robot.now_ns)
    run_silently(robot, 0.1)
    assert mode(robot) is GuardMode.DAMP
    robot.reset()
    run_silently(robot, 0.5)
    assert mode(robot) is GuardMode.SILENT
    assert not robot.fallen


def test_comes_up_stopped_in_the_pose_of_any_start() -> None:
    free, stopped = plant(), Plant(SimConfig(), StopRecord(latched=True, stops=4))
    assert stopped.truth().guard is GuardMode.ESTOP
    assert stopped.truth().base_position == pytest.approx(free.truth().base_position)
    assert stopped.reset_count == 0
    stopped.step()
    assert np.abs(stopped.truth().joint_torque).max() < 1.0
    assert stopped.guard.clear(4, stopped.now_ns)
    stopped.reset()
    run_silently(stopped, 0.5)
    assert stopped.truth().base_position[2] == pytest.approx(
        free.truth().base_position[2], abs=1e-3
    )


def test_a_robot_still_standing_after_the_clear_is_caught_smoothly() -> None:
    robot = plant()
    stander = Stander(robot)
    stander.run(robot, 0.1)
    robot.guard.estop("keyboard", "smoke")
    run_silently(robot, 0.03)
    assert robot.guard.clear(1, robot.now_ns)
    robot.step()
    stander.run(robot, 1.0)
    assert mode(robot) is GuardMode.ACTIVE
    assert not robot.fallen


def test_after_damping_a_far_command_is_refused_and_a_near_one_ramps_in() -> None:
    robot = plant(guard={"hold_after": 0.1, "damp_after": 0.2})
    Stander(robot).run(robot, 0.1)
    run_silently(robot, 0.23)
    assert mode(robot) is GuardMode.DAMP
    state = robot.truth()
    elbow = JOINT_INDEX["l_elbow_fe"]

    def command(distance: float) -> JointCommand:
        position = state.joint_position.copy()
        position[elbow] -= distance
        return make_command(robot.now_ns, position=position)

    for distance in (0.4, -0.4):
        assert not robot.offer(command(distance))
        assert robot.guard.last_refusal is Refusal.FAR
    assert robot.offer(command(0.25))
    robot.step()
    torque = robot.truth().joint_torque[elbow]
    assert -4.0 < torque < 0.0, "100 N·m/rad act on 0.02 rad at first, not on 0.25 rad"


def test_reset_restores_the_pose_but_not_the_time() -> None:
    robot = plant()
    start = robot.truth()
    assert start.header.stamp == START_NS
    assert start.reset_count == 0
    stander = Stander(robot)
    stander.run(robot, 0.1)
    robot.push(np.array([200.0, 0.0, 0.0]), 5.0)
    run_silently(robot, 1.0)
    in_flight = stander.command(robot.truth())
    robot.reset()
    again = robot.truth()
    assert again.reset_count == 1
    assert again.header.stamp == START_NS + 1101 * MS
    assert np.array_equal(again.joint_position, start.joint_position)
    assert np.array_equal(again.base_position, start.base_position)
    assert not robot.data.xfrc_applied.any(), "the push is over"
    assert not robot.offer(in_flight)
    assert robot.guard.last_refusal is Refusal.BEFORE_RESET
    run_silently(robot, 0.5)
    assert not robot.fallen


def record(robot: Plant) -> bytes:
    """Bytes of every state of an eventful second."""
    stander = Stander(robot)
    states = []
    for k in range(10):
        stander.run(robot, 0.05)
        if k == 3:
            robot.push(np.array([60.0, -20.0, 0.0]), 0.1)
        run_silently(robot, 0.05)
        states.append(state_bytes(robot.measured()))
    return b"".join(states)


def test_two_runs_are_byte_identical() -> None:
    settings: Any = {"noise": TYPICAL_NOISE, "start_yaw_spread": 0.5, "seed": 7}
    one, two, other = plant(**settings), plant(**settings), plant(**(settings | {"seed": 8}))
    assert record(one) == record(two)
    assert record(other) != record(two)


def test_a_reset_with_the_same_seed_repeats_the_start() -> None:
    robot = plant(start_position_spread=0.1, start_yaw_spread=0.3)
    robot.reset(seed=5)
    first = robot.truth()
    robot.reset(seed=6)
    second = robot.truth()
    robot.reset(seed=5)
    again = robot.truth()
    assert np.array_equal(first.base_position, again.base_position)
    assert np.array_equal(first.base_quaternion, again.base_quaternion)
    assert not np.array_equal(first.base_position, second.base_position)
    assert np.abs(second.base_position[:2]).max() <= 0.1
    run_silently(robot, 0.5)
    assert robot.truth().base_position[2] == pytest.approx(first.base_position[2], abs=1e-3)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf, 1e5])
@pytest.mark.parametrize(
    ("part", "joint"),
    [
        ("qpos", "l_knee_fe_jp"),
        ("qvel", "r_ankle_ie"),
        ("qvel", "door_hinge"),
        ("qpos", "door_hinge"),
    ],
)
def test_divergence_of_robot_or_scene_is_noticed_in_the_step_and_reset_mends_it(
    door: Plant, part: str, joint: str, value: float
) -> None:
    robot = door
    getattr(robot.data.joint(joint), part)[:] = value
    with pytest.raises(PlantDivergedError, match="expected positions and speeds"):
        robot.step()
    robot.reset()
    run_silently(robot, 0.05)
    assert np.isfinite(robot.data.qpos).all()
    assert not robot.fallen


@pytest.fixture(scope="module")
def door() -> Plant:
    return plant(scene="door")


def test_divergence_names_the_joint(door: Plant) -> None:
    door.data.joint("door_hinge").qvel[:] = 2e3
    with pytest.raises(PlantDivergedError, match=r"speed .* of door_hinge"):
        door.step()
    door.reset()


def test_contacts_name_what_touches() -> None:
    robot = plant()
    run_silently(robot, 0.2)
    contacts = robot.contacts()
    assert [(c.first, c.second) for c in contacts] == [
        ("floor", "l_foot_col"),
        ("floor", "r_foot_col"),
    ]
    assert sum(c.force for c in contacts) == pytest.approx(WEIGHT, rel=0.02)


def test_no_contact_no_force() -> None:
    robot = plant()
    robot.data.qpos[2] += 0.3
    robot.step()
    assert robot.truth().foot_normal_force == pytest.approx([0.0, 0.0])
    assert robot.contacts() == []


def test_command_ages_are_robot_time_since_the_stamp() -> None:
    robot = plant()
    Stander(robot).run(robot, 0.1)
    assert list(robot.command_ages) == pytest.approx([0.005] * 10)


def test_linear_velocity_is_in_the_world_and_angular_in_the_body() -> None:
    robot = plant(start_yaw_spread=3.0, seed=1)
    robot.data.qpos[2] += 0.5
    robot.data.qvel[:6] = 1.0, 0.3, 0.0, 0.4, 0.8, -0.2
    before = robot.truth()
    assert abs(before.base_quaternion[3]) > 0.2, "turned, so that body and world differ"
    robot.step()
    after = robot.truth()
    moved = (after.base_position - before.base_position) / 1e-3
    assert moved == pytest.approx(after.base_linear_velocity, abs=1e-9)
    w, v = before.base_quaternion[0], -before.base_quaternion[1:]
    # Vector part of conj(q0) q1, the turn seen in the body.
    turned = w * after.base_quaternion[1:] + after.base_quaternion[0] * v
    turned += np.cross(v, after.base_quaternion[1:])
    assert 2.0 * turned / 1e-3 == pytest.approx(after.base_angular_velocity, abs=1e-4)
