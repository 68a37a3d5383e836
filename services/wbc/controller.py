"""The whole-body controller without a bus: measured state and set-points in, joint command out."""

from dataclasses import dataclass
from math import asin, hypot, sqrt
from pathlib import Path
from time import perf_counter

import numpy as np

from common.robot import joints
from common.schemas import ControlState, Gait, PlantState, Setpoint
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import WbcConfig
from services.wbc.dcm import GRAVITY, natural_frequency
from services.wbc.dual_method import controller_solver
from services.wbc.handover import HandOver, Target
from services.wbc.hands import HandReference
from services.wbc.layout import COM, FEET, HANDS, NV, TORSO
from services.wbc.locomotion import Locomotion
from services.wbc.qp import QpBuilder, QpData
from services.wbc.references import BodyReference
from services.wbc.robot_model import Dynamics, RobotModel, RobotState
from services.wbc.solvers import Solution, Solver
from services.wbc.tasks import POSTURE, TaskStack

TORQUE_SHARE = joints.MOTOR_TO_JOINT / joints.MOTOR_TO_JOINT.sum(axis=0)
"""(27, 25): by virtual work each hinge of a knee gets half of its coordinate's torque."""
MAX_DUMPS = 20
"""Largest number of unsolved QPs written to disk by one controller."""
ACCELERATION_DECAY = 0.9
"""Factor per tick of the accelerations of a command that is repeated without a new solution."""


@dataclass(frozen=True)
class Command:
    """Joint command of one tick.

    Attributes:
        position: (27,) [rad].
        velocity: (27,) [rad/s].
        acceleration: (27,) [rad/s²].
        torque: (27,) feed-forward [N·m].
    """

    position: Array
    velocity: Array
    acceleration: Array
    torque: Array


@dataclass(frozen=True)
class TickReport:
    """Diagnostics of one tick.

    Attributes:
        stages: wall time of model, tasks, build and solve [s].
        dcm_error: horizontal distance of the DCM from its reference [m].
        hand_error: (2, 2) distance [m] and angle [rad] of each hand from its last set-point.
        com: (3,) measured CoM in world [m].
        solved: whether the QP was solved.
        status: of the solver.
    """

    stages: dict[str, float]
    dcm_error: float
    hand_error: Array
    com: Array
    solved: bool
    status: str


class Controller:
    """Implicit-hierarchical whole-body controller (Seo et al. 2023, sec. III-C).

    Times are robot time, taken from the states, so the plant's real-time factor does not matter.

    Attributes:
        hand_over: lets the targets of a new operator begin where those of the last one ended.
    """

    def __init__(self, config: WbcConfig) -> None:
        self.config = config
        self.model = RobotModel()
        self.builder = QpBuilder(config)
        self.solver: Solver = controller_solver(config.solver)
        self.stack = TaskStack(config.tasks)
        self.unsolved = 0
        self._hand_shares = np.repeat([1.0, config.tasks.hand_rotation_share], 3)
        self._omega = natural_frequency(config.gait.com_height)
        self.restart()

    def restart(self) -> None:
        """Discard plans, references and set-points; the next tick takes the robot over as it is.

        Model and solver workspace are kept, for building them takes longer than the silence after
        which the plant's guard begins to hold.
        """
        config = self.config
        self.locomotion = Locomotion(config)
        self.hands = (HandReference("left", config.hands), HandReference("right", config.hands))
        self.hand_weight = config.tasks.hand_weight_walking
        self._gripper: Array | None = None
        self.hand_over = HandOver(config.authority)
        nominal = joints.NOMINAL_POSITION[list(joints.MOTOR_POSITION_INDEX)]
        self._posture_target = nominal[12:].copy()
        self._last: tuple[Command, Array] | None = None

    @property
    def started(self) -> bool:
        """Whether there was a tick since the last restart, so that there is a target."""
        return self._gripper is not None

    @property
    def grippers(self) -> Array:
        """(2,) left and right closure that the grippers are sent."""
        assert self._gripper is not None
        return self._gripper

    @property
    def target(self) -> Target:
        """What hands, grippers and neck follow; from the first tick on, at first as measured."""
        positions, rotations = zip(*(hand.target for hand in self.hands), strict=True)
        neck = float(self._posture_target[-1])
        return Target(np.array(positions), np.array(rotations), self.grippers, neck)

    def request(self, request_id: int, gait: Gait) -> None:
        """Request a gait; ``locomotion.answers()`` will hold the answer."""
        self.locomotion.request(request_id, gait)

    def set_setpoint(self, setpoint: Setpoint, time: float) -> None:
        """Apply a set-point received at robot time ``time`` [s], once :attr:`started`."""
        target = self.hand_over.apply(Target.of(setpoint), self.target, time)
        poses = zip(self.hands, target.positions, target.rotations, strict=True)
        for hand, position, rotation in poses:
            hand.set(position, rotation, time)
        self._gripper = np.clip(target.grippers, 0.0, 1.0)
        low, high = joints.POSITION_LOWER[joints.NECK][0], joints.POSITION_UPPER[joints.NECK][0]
        self._posture_target[-1] = min(max(target.neck, low), high)

    def tick(self, state: PlantState, time: float) -> tuple[Command, TickReport]:
        """Compute the joint command for a state at robot time ``time`` [s]."""
        clock = perf_counter()
        dynamics = self.model.update(RobotState.from_plant(state))
        after_model = perf_counter()
        if not self.started:
            self._gripper = np.clip(state.gripper_closure, 0.0, 1.0)
            for hand, kinematics in zip(self.hands, dynamics.hands, strict=True):
                hand.hold(kinematics.position, kinematics.rotation, time)
        body = self.locomotion.update(dynamics, state.foot_normal_force, time)
        self._fill_tasks(dynamics, body, time)
        after_tasks = perf_counter()
        data = self.builder.build(
            dynamics, self.stack, body.normal_force_max, self._force_share(body)
        )
        after_build = perf_counter()
        solution = self.solver.solve(data)
        after_solve = perf_counter()
        command = self._command(state, dynamics, data, solution)
        stages = {
            "model": after_model - clock,
            "tasks": after_tasks - after_model,
            "build": after_build - after_tasks,
            "solve": after_solve - after_build,
        }
        return command, self._report(dynamics, body, solution, stages)

    def _fill_tasks(self, dynamics: Dynamics, body: BodyReference, time: float) -> None:
        stack, torso = self.stack, body.torso
        stack.position[COM], stack.rotation[0] = body.com, torso.rotation
        stack.velocity[COM], stack.acceleration[COM] = body.com_velocity, body.com_acceleration
        stack.velocity[TORSO], stack.acceleration[TORSO] = torso.rate, torso.acceleration
        self._hand_tasks(time)
        tasks = self.config.tasks
        light, heavy = tasks.foot_weight_swing, tasks.foot_weight_stance
        for side, rows in enumerate(FEET):
            stack.follow_foot(side, body.swing[side])
            stack.weight[rows] = light + body.load[side] * (heavy - light)
        stack.position[POSTURE] = self._posture_target
        stack.finish(dynamics)

    def _hand_tasks(self, time: float) -> None:
        tasks = self.config.tasks
        balancing = self.locomotion.state is ControlState.BALANCE
        goal = tasks.hand_weight_balancing if balancing else tasks.hand_weight_walking
        if goal != self.hand_weight:
            span = abs(tasks.hand_weight_balancing - tasks.hand_weight_walking)
            step = span / (tasks.hand_weight_ramp * self.config.rate)
            self.hand_weight += min(max(goal - self.hand_weight, -step), step)
        weight = self.hand_weight * self._hand_shares
        for side, hand in enumerate(self.hands):
            self.stack.follow(side, hand.at(time))
            self.stack.weight[HANDS[side]] = weight

    def _force_share(self, body: BodyReference) -> tuple[float, float]:
        weight = self.model.mass * GRAVITY
        total = max(1e-6, body.load[0] + body.load[1])
        return weight * body.load[0] / total, weight * body.load[1] / total

    def _command(
        self, state: PlantState, dynamics: Dynamics, data: QpData, solution: Solution
    ) -> Command:
        if solution.solved:
            acceleration = solution.x[6:NV]
            torque = self.builder.torques(dynamics, solution.x)
        else:
            self.unsolved += 1
            self._dump(data, solution)
            torque, acceleration = self._fallback(dynamics)
        G = joints.MOTOR_TO_JOINT
        command = Command(
            state.joint_position,
            state.joint_velocity,
            G.dot(acceleration),
            TORQUE_SHARE.dot(torque),
        )
        self._last = (command, torque)
        return command

    def _fallback(self, dynamics: Dynamics) -> tuple[Array, Array]:
        """Return the last torques with fading accelerations; without any, those against gravity."""
        if self._last is None:
            return dynamics.bias_force[6:].copy(), np.zeros(NV - 6)
        command, torque = self._last
        motors = list(joints.MOTOR_POSITION_INDEX)
        return torque, ACCELERATION_DECAY * command.acceleration[motors]

    def _dump(self, data: QpData, solution: Solution) -> None:
        directory = self.config.qp_dump_dir
        if not directory or self.unsolved > MAX_DUMPS:
            return
        path = Path(directory)
        path.mkdir(parents=True, exist_ok=True)
        np.savez_compressed(
            path / f"qp_{self.unsolved:04d}.npz",
            **vars(data), status=solution.status,
        )  # fmt: skip

    def _report(
        self,
        dynamics: Dynamics,
        body: BodyReference,
        solution: Solution,
        stages: dict[str, float],
    ) -> TickReport:
        # In plain numbers: for two or three of them numpy takes longer.
        (x, y, _), (vx, vy, _) = dynamics.com_position.tolist(), dynamics.com_velocity.tolist()
        dcm_x, dcm_y = body.dcm.tolist()
        errors = []
        for hand, kinematics in zip(self.hands, dynamics.hands, strict=True):
            position, rotation = hand.target
            offset, turn = position - kinematics.position, (rotation - kinematics.rotation).ravel()
            # The Frobenius norm of a difference of rotations is sqrt(8) sin(angle / 2).
            sine = min(1.0, sqrt(turn.dot(turn) / 8.0))
            errors.append((sqrt(offset.dot(offset)), 2.0 * asin(sine)))
        return TickReport(
            stages,
            hypot(x + vx / self._omega - dcm_x, y + vy / self._omega - dcm_y),
            np.array(errors),
            dynamics.com_position,
            solution.solved,
            solution.status,
        )
