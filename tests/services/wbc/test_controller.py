"""The tick: what is asked of the QP, what becomes of its answer, and what if there is none."""

from pathlib import Path

import numpy as np
import pytest

from common.robot import frames, joints
from common.robot.rotations import (
    matrix_from_rotation_vector,
    matrix_from_yaw,
    rotation_vector_from_matrix,
    yaw_from_matrix,
)
from common.schemas import Gait
from services.sim.physics.stance import standing_torque
from services.wbc.config import TaskConfig, WbcConfig
from services.wbc.controller import MAX_DUMPS, TORQUE_SHARE, Command, Controller
from services.wbc.layout import COM, FEET, HANDS, TORSO
from services.wbc.qp import NORMAL, QpBuilder, QpData
from services.wbc.references import PoseReference
from services.wbc.robot_model import Dynamics, RobotModel, RobotState
from services.wbc.solvers import make_solver
from services.wbc.tasks import POSTURE, TaskStack, posture_gains

from .bench import Bench
from .support import Array, nominal_state, random_states, setpoint

CONFIG = WbcConfig(solver="daqp")
HEIGHT = 0.74
DT = 0.01


def _started() -> Controller:
    """After one tick, and with an operator that began at the present target."""
    controller = Controller(CONFIG)
    _tick(controller, 0)
    controller.set_setpoint(controller.target.setpoint(0), 0.0)
    return controller


class Impossible(QpBuilder):
    """Wants feet that pull: no QP has a solution."""

    def build(
        self,
        dynamics: Dynamics,
        stack: TaskStack,
        normal_force_max: tuple[float, float],
        normal_force_desired: tuple[float, float],
    ) -> QpData:
        data = super().build(dynamics, stack, normal_force_max, normal_force_desired)
        data.u[NORMAL], data.l[31] = -50.0, 0.0
        return data


def _tick(controller: Controller, k: int) -> Command:
    state = nominal_state(stamp=k * 10_000_000, height=HEIGHT)
    command, _ = controller.tick(state, k * DT)
    return command


def _fields(command: Command) -> list[Array]:
    return [command.position, command.velocity, command.acceleration, command.torque]


@pytest.mark.parametrize("solver", ["osqp", "daqp", "quadprog"])
def test_without_a_solution_the_last_command_fades(solver: str) -> None:
    controller = Controller(WbcConfig(solver=solver))  # type: ignore[arg-type]
    for k in range(8):
        last = _tick(controller, k)
    assert controller.unsolved == 0
    controller.builder = Impossible(controller.config)
    assert np.abs(last.acceleration).max() > 0.1
    for k in range(8, 14):
        command, report = controller.tick(nominal_state(k, HEIGHT), k * DT)
        assert not report.solved
        assert report.status
        assert all(np.isfinite(field).all() for field in _fields(command))
        assert np.abs(command.torque - last.torque).max() < 1e-12
        assert command.acceleration == pytest.approx(0.9 ** (k - 7) * last.acceleration)
        assert np.array_equal(command.position, joints.NOMINAL_POSITION)
    assert controller.unsolved == 6
    controller.builder = QpBuilder(controller.config)
    assert controller.tick(nominal_state(20, HEIGHT), 0.14)[1].solved
    assert controller.unsolved == 6


def test_without_any_solution_yet_gravity_is_held() -> None:
    controller = Controller(CONFIG)
    controller.builder = Impossible(CONFIG)
    command = _tick(controller, 0)
    gravity = RobotModel().update(RobotState.from_plant(nominal_state())).bias_force[6:]
    assert np.abs(command.torque - TORQUE_SHARE @ gravity).max() < 1e-12
    assert not command.acceleration.any()


def test_unsolved_qps_are_kept_for_inspection(tmp_path: Path) -> None:
    folder = tmp_path / "a" / "b"
    controller = Controller(WbcConfig(solver="daqp", qp_dump_dir=str(folder)))
    controller.builder = Impossible(controller.config)
    for k in range(MAX_DUMPS + 5):
        _tick(controller, k)
    files = sorted(folder.iterdir())
    assert [f.name for f in files] == [f"qp_{k:04d}.npz" for k in range(1, MAX_DUMPS + 1)]
    with np.load(files[0]) as kept:
        data = QpData(**{name: kept[name] for name in kept.files if name != "status"})
        assert "daqp" in str(kept["status"])
    assert data.A.shape == (92, 43)
    # What was kept is what failed.
    again = make_solver("quadprog").solve(data)
    assert not again.solved


def test_solved_or_nowhere_to_go_nothing_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    controller = Controller(CONFIG)
    controller.builder = Impossible(CONFIG)
    _tick(controller, 0)
    keeping = Controller(WbcConfig(solver="daqp", qp_dump_dir="kept"))
    _tick(keeping, 0)
    assert list(tmp_path.iterdir()) == []


def test_command_sends_what_was_measured_and_solved() -> None:
    """Knee halves agree; position and velocity are the measured ones, the plant extrapolates."""
    controller = Controller(CONFIG)
    for k, state in enumerate(random_states(5, seed=21)):
        command, report = controller.tick(state, k * DT)
        assert np.array_equal(command.position, state.joint_position)
        assert np.array_equal(command.velocity, state.joint_velocity)
        for jp, jd in joints.KNEE_INDICES:
            assert command.acceleration[jp] == command.acceleration[jd]
            assert command.torque[jp] == command.torque[jd]
        assert set(report.stages) == {"model", "tasks", "build", "solve"}
        assert min(report.stages.values()) > 0.0


def test_task_rows_are_the_models_jacobians(model: RobotModel) -> None:
    controller = Controller(CONFIG)
    stack = controller.stack
    for k, state in enumerate(random_states(5, seed=33)):
        controller.tick(state, k * DT)
        dynamics = model.update(RobotState.from_plant(state))
        assert np.array_equal(stack.jacobian[COM], dynamics.jacobian[COM])
        torso = np.zeros((3, 31))
        torso[:, 3:6] = dynamics.base_rotation
        assert np.array_equal(stack.jacobian[TORSO], torso)
        for side in (0, 1):
            assert np.array_equal(stack.jacobian[HANDS[side]], dynamics.jacobian[HANDS[side]])
            assert np.array_equal(stack.jacobian[FEET[side]], dynamics.jacobian[FEET[side]])
            # A standing foot is asked for no acceleration: J qdd = -Jdot v.
            assert np.abs(stack.target[FEET[side]] + dynamics.bias[FEET[side]]).max() < 1e-12
        upper = np.zeros((13, 31))
        upper[:, 18:] = np.eye(13)
        assert np.array_equal(stack.jacobian[POSTURE], upper)


def test_first_targets_only_brake(model: RobotModel) -> None:
    """Taken over in motion, every reference starts where the robot is: damping, less Jdot v."""
    for state in random_states(5, seed=34):
        controller = Controller(CONFIG)
        controller.tick(state, 1.0)
        target, dynamics = controller.stack.target, model.update(RobotState.from_plant(state))
        kd = np.array([13.0, 13.0, 20.0])
        braking = -kd * dynamics.com_velocity - dynamics.bias[COM]
        assert np.abs(target[COM] - braking).max() < 1e-9
        for rows in HANDS:
            kd = np.repeat([28.0, 24.0], 3)
            braking = -kd * dynamics.velocity[rows] - dynamics.bias[rows]
            assert np.abs(target[rows] - braking).max() < 1e-9
        # The torso is righted at once, its heading kept.
        rotation = dynamics.base_rotation
        upright = rotation_vector_from_matrix(
            matrix_from_yaw(yaw_from_matrix(rotation)) @ rotation.T
        )
        rate = rotation @ dynamics.base_twist[3:]
        assert np.abs(target[TORSO] - (100.0 * upright - 20.0 * rate)).max() < 1e-9
        kp, kd, _ = posture_gains(CONFIG.tasks)
        motors = list(joints.MOTOR_POSITION_INDEX)[12:]
        error = joints.NOMINAL_POSITION[motors] - state.joint_position[motors]
        posture = kp * error - kd * state.joint_velocity[motors]
        assert np.abs(target[POSTURE] - posture).max() < 1e-9


def test_pose_task_is_a_pd_law_with_feed_forward(model: RobotModel) -> None:
    dynamics = model.update(RobotState.from_plant(random_states(1, seed=2)[0]))
    hand, stack = dynamics.hands[0], TaskStack(TaskConfig())
    turn = np.array([0.1, -0.2, 0.3])
    offset, velocity = np.array([0.01, 0.02, -0.03]), np.arange(6.0)
    reference = PoseReference(
        hand.position + offset,
        matrix_from_rotation_vector(turn) @ hand.rotation,
        dynamics.velocity[HANDS[0]] + velocity,
        np.full(6, 2.0),
    )
    stack.follow(0, reference)
    stack.finish(dynamics)
    desired = stack.target[HANDS[0]] + dynamics.bias[HANDS[0]]
    assert desired[:3] == pytest.approx(2.0 + 200.0 * offset + 28.0 * velocity[:3])
    assert desired[3:] == pytest.approx(2.0 + 150.0 * turn + 24.0 * velocity[3:])


def test_posture_gains_by_joint() -> None:
    kp, kd, weight = posture_gains(TaskConfig())
    arm = [50.0, 50.0, 50.0, 25.0, 20.0, 20.0]
    assert kp.tolist() == [*arm, *arm, 100.0]
    arm = [20.0, 20.0, 20.0, 12.0, 8.0, 8.0]
    assert kd.tolist() == [*arm, *arm, 20.0]
    assert weight.tolist() == [0.02] * 12 + [1.0]


def test_stack_sums_weighted_squares() -> None:
    rng = np.random.default_rng(0)
    stack = TaskStack(TaskConfig())
    stack.jacobian[:], stack.target[:] = rng.normal(size=(43, 31)), rng.normal(size=43)
    stack.weight[:] = rng.uniform(size=43)
    hessian, gradient = stack.quadratic()
    qdd = rng.normal(size=31)
    residual = stack.jacobian @ qdd - stack.target
    constant = 0.5 * stack.weight @ stack.target**2
    cost = 0.5 * stack.weight @ residual**2
    assert 0.5 * qdd @ hessian @ qdd + gradient @ qdd + constant == pytest.approx(cost)


def test_setpoints_reach_hands_grippers_and_neck() -> None:
    controller = _started()
    left, right = np.array([0.35, 0.2, 0.1]), np.array([0.9, -0.3, 0.2])
    controller.set_setpoint(setpoint(left, right, closure=(0.25, 1.0), neck=9.0), 0.01)
    ahead = np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]])
    assert controller.target.positions[0] == pytest.approx(left, abs=1e-12)
    assert controller.target.positions[1] == pytest.approx([0.56, -0.3, 0.2], abs=1e-12)
    assert np.abs(controller.hands[0].target[1] - ahead).max() < 1e-12
    assert controller.target.grippers == pytest.approx([0.25, 1.0])
    # The neck's target is kept inside its limit of 1.309 rad.
    _tick(controller, 1)
    assert controller.stack.target[POSTURE][-1] == pytest.approx(100.0 * 1.309)


def test_hands_hold_where_they_are_found(model: RobotModel) -> None:
    controller = Controller(CONFIG)
    _, report = controller.tick(nominal_state(0, HEIGHT), 0.0)
    for side, name in enumerate(("left", "right")):
        target, rotation = controller.hands[side].target
        assert target == pytest.approx(np.array(frames.NOMINAL_HAND_IN_BODY[name]), abs=1e-6)
        found = model.update(RobotState.from_plant(nominal_state())).hands[side].rotation
        assert np.abs(rotation_vector_from_matrix(rotation @ found.T)).max() < 1e-12
    assert np.abs(report.hand_error).max() < 1e-9


def test_hand_error_is_measured_to_the_last_setpoint() -> None:
    controller = _started()
    places = [np.array(frames.NOMINAL_HAND_IN_BODY[side]) for side in ("left", "right")]
    controller.set_setpoint(setpoint(places[0] + np.array([0.03, 0.0, 0.04]), places[1]), time=0.01)
    _, report = controller.tick(nominal_state(1, HEIGHT), 0.01)
    assert report.hand_error[:, 0] == pytest.approx([0.05, 0.0], abs=1e-6)


def test_hand_weight_is_high_only_while_balancing() -> None:
    bench = Bench(WbcConfig(solver="daqp", stand_time=0.3))
    bench.run(0.2)
    assert bench.states[-1].hand_weight == pytest.approx(10.0)
    bench.run(0.7)
    weights = [state.hand_weight for state in bench.states]
    assert weights[-1] == pytest.approx(20.0)
    # From 10 to 20 in 0.5 s.
    assert np.diff(weights).max() == pytest.approx(10.0 * DT / 0.5)
    bench.ask(Gait.SIDE_LEFT)
    bench.run(0.6)
    assert bench.states[-1].hand_weight == pytest.approx(10.0)


def test_standing_still_takes_the_torques_of_statics() -> None:
    """At rest the command is what MuJoCo's statics ask for on both feet: 44 N·m at each knee."""
    bench = Bench(WbcConfig(solver="daqp", stand_time=0.3))
    bench.run(1.2)
    plant, command = bench.plant, bench.commands[-1]
    statics = standing_torque(plant.model, plant.addresses, plant.data.qpos.copy())
    assert np.abs(command.torque - statics).max() < 0.2
    assert 40.0 < np.abs(joints.MOTOR_TO_JOINT.T @ statics).max() < 50.0
    truth = plant.truth()
    assert truth.foot_normal_force.sum() == pytest.approx(36.522 * 9.81, rel=0.02)
    assert np.abs(truth.joint_velocity).max() < 0.02
    assert bench.states[-1].com_in_world[2] == pytest.approx(0.70, abs=0.004)
    assert bench.states[-1].dcm_error < 0.004


def test_the_first_command_already_carries_the_weight() -> None:
    bench = Bench(WbcConfig(solver="daqp"))
    bench.tick()
    torque = bench.commands[0].torque
    for pair in joints.KNEE_INDICES:
        assert torque[list(pair)].sum() == pytest.approx(-44.0, abs=10.0)


def test_grippers_stay_as_found_until_told_otherwise() -> None:
    controller = Controller(CONFIG)
    holding, slipped = (
        nominal_state(0, HEIGHT).model_copy(update={"gripper_closure": np.array(closure)})
        for closure in ([0.8, 0.0], [0.6, 0.1])
    )
    controller.tick(holding, 0.0)
    assert controller.target.grippers.tolist() == [0.8, 0.0]
    # The jaw gives way a little under load; the command must not follow it.
    controller.tick(slipped, 0.01)
    assert controller.target.grippers.tolist() == [0.8, 0.0]
    controller.restart()
    controller.tick(slipped, 0.02)
    assert controller.target.grippers.tolist() == [0.6, 0.1]
