"""The simulated robot without a bus: physics, motor servo and command guard, 1 ms a step."""

import logging
import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np

from common.plant.config import PHYSICS_STEP_NS
from common.plant.fallback import Hold, damp_target, hold_target, plan_hold
from common.plant.guard import Guard
from common.plant.servo import JOINT_TO_MOTOR, Servo, motor_target
from common.plant.stop import StopRecord
from common.robot.joints import NUM_MOTORS
from common.schemas import GuardMode, Header, JointCommand, PlantState
from common.schemas.arrays import Float64Array as Array
from common.wire.builder import assembler
from services.sim.config import NoiseConfig, SimConfig
from services.sim.model.contacts import GeomContact, foot_normal_forces, geom_contacts
from services.sim.model.robot_state import RobotReader, jaw_command
from services.sim.model.world import build_model, find_addresses
from services.sim.physics.divergence import check_state
from services.sim.physics.noise import add_noise
from services.sim.physics.stance import standing_qpos, standing_torque
from services.sim.physics.steps import PhysicsSteps
from services.sim.tasks import find_task
from services.sim.tasks.registry import with_task
from services.sim.tasks.trial import SceneView, Trial

START_NS = 1_000_000_000
"""Robot time of the first state; positive, so that a stamp of 0 never is a measurement."""

_AGES_KEPT = 1024
_MOST_STEPS = 1000
"""Of physics between two looks of the guard."""
_SETTLING_STEPS = 200
_LOG = logging.getLogger(__name__)
_HEADER = Header().__dict__
_assemble_header: Callable[[dict[str, Any]], Header] = assembler(Header)
_assemble: Callable[[dict[str, Any]], PlantState] = assembler(PlantState)


class Plant:
    """DRACO 3 in a scene, behind its motor servo and command guard.

    Attributes:
        config: the given one, completed by the scene and the noise of the task.
        model: the ``mujoco.MjModel``.
        data: the ``mujoco.MjData``.
        guard: the command guard.
        servo: the motor servo.
        now_ns: robot time [ns]; grows by one physics step a step and never goes back.
        reset_count: resets since construction.
        steps: physics steps since the last reset.
        fallen: whether the robot has fallen since the last reset.
        trial: of the configured task; None without one. Its clock starts with the first command
            that is applied after a reset.
        view: reads the states of the scene's objects.
    """

    def __init__(self, config: SimConfig | None = None, stop: StopRecord | None = None) -> None:
        """Build the model; a latched ``stop`` is in force from the beginning."""
        self.config = with_task(config or SimConfig())
        # MuJoCo's own handler writes a log file into the working directory.
        mujoco.set_mju_user_warning(_log_warning)
        self.model = build_model(self.config.scene, visuals=False)
        self.data = mujoco.MjData(self.model)
        self.addresses = find_addresses(self.model)
        self.trial: Trial | None = None
        if self.config.task:
            task = find_task(self.config.task)
            self.trial = Trial(task, self.model, self.data, self.addresses, self.config.task_spread)
            self.view = self.trial.view
        else:
            scene = self.config.scene
            self.view = SceneView(self.model, self.data, self.addresses, scene, None)
        self.guard = Guard(self.config.guard)
        self.servo = Servo(self.config.torque_mode)
        self._ages, self._ages_count = np.zeros(_AGES_KEPT), 0
        self._standing = standing_qpos(
            self.model, self.addresses, self.config.standing_com_height, self.config.stance_width
        )
        self._standing_torque = standing_torque(self.model, self.addresses, self._standing)
        # Views of MuJoCo's memory, which it never moves.
        self._qpos, self._qvel = self.data.qpos, self.data.qvel
        self._ctrl = self.data.ctrl
        self._motor_torque = self._ctrl[:NUM_MOTORS]
        self._grippers = self.addresses.grippers.tolist()
        self._physics = PhysicsSteps(self.model, self.data, self.addresses.torso, self.servo)
        self._reader = RobotReader(self.data, self.addresses)
        self._torque_mode = self.config.torque_mode.value
        self._noiseless = self.config.noise == NoiseConfig()
        self.now_ns = START_NS - PHYSICS_STEP_NS
        self.reset_count = -1
        self.reset()
        self._settle_into_floor()
        self.guard = Guard(self.config.guard, stop)
        self.reset()

    def reset(self, seed: int | None = None) -> None:
        """Put the robot back to its start at rest, with a silent guard; robot time goes on.

        Args:
            seed: of start pose and noise; None: the configured seed plus the reset count.
        """
        self.reset_count += 1
        seed = self.config.seed + self.reset_count if seed is None else seed
        self._rng = np.random.default_rng(seed)
        mujoco.mj_resetData(self.model, self.data)
        self._qpos[:] = self._standing
        self._draw_start_pose()
        if self.trial is not None:
            self.trial.restart(seed)
        self._trial_from: int | None = None
        self.guard.reset(epoch_ns=self.now_ns)
        self.now_ns += PHYSICS_STEP_NS
        self.steps = 0
        self.servo.saturated_steps = 0
        self.fallen = False
        self._push_until_ns = 0
        self._mode = GuardMode.SILENT
        self._hold: Hold | None = None
        self._target = hold_target(
            self.now_ns, self._qpos[self.addresses.qpos], self._standing_torque
        )
        self._motor_torque[:] = JOINT_TO_MOTOR @ self._standing_torque
        self._ctrl[self._grippers] = jaw_command(0.0)
        mujoco.mj_forward(self.model, self.data)

    def _settle_into_floor(self) -> None:
        """Start as deep in the compliant floor as a robot that has stood for a while."""
        for _ in range(_SETTLING_STEPS):
            self.step()
        self._standing[2] = self._qpos[2]
        self.now_ns = START_NS - PHYSICS_STEP_NS
        self.reset_count = -1

    def _draw_start_pose(self) -> None:
        """Draw position and heading within the configured spread."""
        spread, yaw_spread = self.config.start_position_spread, self.config.start_yaw_spread
        x, y = self._rng.uniform(-spread, spread, 2)
        half_yaw = 0.5 * self._rng.uniform(-yaw_spread, yaw_spread)
        self._qpos[:2] = x, y
        self._qpos[3:7] = math.cos(half_yaw), 0.0, 0.0, math.sin(half_yaw)

    def offer(self, command: JointCommand) -> bool:
        """Pass a command through the guard and return whether it is applied."""
        measured = self._qpos.take(self.addresses.qpos)
        if not self.guard.offer(command, self.now_ns, measured):
            return False
        stamp = command.header.stamp
        self._target = motor_target(
            stamp,
            self.guard.eased(command.position, self.now_ns, measured),
            command.velocity,
            command.acceleration,
            command.torque,
            command.stiffness,
            command.damping,
        )
        for motor, closure in zip(self._grippers, command.gripper_closure.tolist(), strict=True):
            self._ctrl[motor] = jaw_command(closure)
        self._ages[self._ages_count % _AGES_KEPT] = (self.now_ns - stamp) * 1e-9
        self._ages_count += 1
        return True

    def push(self, force: Array, duration: float) -> None:
        """Push the torso at its centre of mass.

        Args:
            force: (3,) in world [N].
            duration: [s] of robot time from now; replaces a push still in progress.
        """
        self.data.xfrc_applied[self.addresses.torso, :3] = force
        self._push_until_ns = self.now_ns + round(duration * 1e9)

    def step(self) -> None:
        """Advance by one physics step; see :meth:`advance`."""
        self.advance(1)

    def advance(self, steps: int) -> None:
        """Advance by physics steps, at most to the one that changes guard mode or trial.

        Args:
            steps: most physics steps, at least one; :attr:`steps` tells how many it were.

        Raises:
            PlantDivergedError: the physics of robot or scene diverged; only :meth:`reset` helps.
        """
        before, last = self.guard.mode, self.steps + steps
        while self.steps < last:
            self._decide()
            changed = self.guard.mode is not before
            self._move(1 if changed else min(last - self.steps, self._undecided_steps()))
            if self._judge() or changed:
                return

    def _decide(self) -> None:
        """Let the guard decide what the motors do in the next physics step."""
        self.fallen = self.fallen or self._physics.is_down()
        mode = self.guard.tick(self.now_ns, self.fallen)
        if mode is not self._mode:
            self._enter(mode)
        if self._hold is not None:
            self._follow(self._hold)

    def _undecided_steps(self) -> int:
        """Return how many physics steps have nothing to decide, judge or end in between."""
        if self._hold is not None or self._trial_runs:
            return 1
        steps = _MOST_STEPS
        if (settled_ns := self.guard.settled_until_ns()) is not None:
            # The guard has decided about the step that begins now.
            steps = min(steps, 1 + (settled_ns - self.now_ns) // PHYSICS_STEP_NS)
        if self._push_until_ns:
            steps = min(steps, -((self.now_ns - self._push_until_ns) // PHYSICS_STEP_NS))
        return max(1, steps)

    def _move(self, steps: int) -> None:
        """Advance the physics by ``steps``, or fewer if the robot falls or the physics diverges."""
        done, is_notable = self._physics.run(
            self._target, self.now_ns, steps, watch_fall=not self.fallen
        )
        self.steps += done
        self.now_ns += done * PHYSICS_STEP_NS
        if is_notable:
            check_state(self.model, self._qpos, self._qvel)
        if self._push_until_ns and self.now_ns >= self._push_until_ns:
            self._push_until_ns = 0
            self.data.xfrc_applied[self.addresses.torso, :3] = 0.0

    @property
    def _trial_runs(self) -> bool:
        return self.trial is not None and self._trial_from is not None

    def _judge(self) -> bool:
        """Let the trial see the last physics step; return whether that has changed it."""
        if self.trial is None or self._trial_from is None:
            return False
        return self.trial.step((self.steps - self._trial_from) * 1e-3, fallen=self.fallen)

    def _enter(self, mode: GuardMode) -> None:
        _LOG.info("guard: %s at %.3f s%s", mode.name, self.now_ns * 1e-9, " (fallen)" * self.fallen)
        self._mode = mode
        self._hold = None
        command = self.guard.command
        if mode is GuardMode.ACTIVE and self._trial_from is None:
            self._trial_from = self.steps
        if mode is GuardMode.HOLD and command is not None:
            self._hold = plan_hold(
                self.now_ns,
                self._qpos[self.addresses.qpos],
                self._qvel[self.addresses.qvel],
                command.torque,
                foot_normal_forces(self.data, self.addresses.feet),
            )
        elif mode in (GuardMode.DAMP, GuardMode.ESTOP):
            self._target = damp_target(self.now_ns)

    def _follow(self, hold: Hold) -> None:
        force = foot_normal_forces(self.data, self.addresses.feet)
        hold = hold.landed(self.now_ns, self._qpos[self.addresses.qpos], force)
        self._target = hold.target(self.now_ns)
        self._hold = hold if self.now_ns < hold.end_ns else None

    def truth(self) -> PlantState:
        """Return the exact state now."""
        controller = self.guard.controller
        # Not validated: the shapes are MuJoCo's, and receivers check the numbers.
        return _assemble(
            {
                "header": _assemble_header(_HEADER | {"stamp": self.now_ns}),
                **self._reader.read(),
                "reset_count": self.reset_count,
                "guard": self.guard.mode,
                "fallen": self.fallen,
                "controller_boot": 0 if controller is None else controller.boot,
                "torque_mode": self._torque_mode,
                "stops": self.guard.stop.stops,
            }
        )

    def measured(self) -> PlantState:
        """Return the state now with the configured sensor noise."""
        truth = self.truth()
        return truth if self._noiseless else add_noise(truth, self.config.noise, self._rng)

    def contacts(self) -> list[GeomContact]:
        """Return the contacts between geoms in the last physics step."""
        return geom_contacts(self.model, self.data)

    def com(self) -> Array:
        """Return the robot's centre of mass (3,) in world after the last physics step [m]."""
        return np.array(self.data.subtree_com[self.addresses.torso])

    @property
    def command_ages(self) -> Array:
        """Ages (n,) of the states behind the last commands when applied, at most 1024 [s]."""
        return self._ages[: self._ages_count]

    @property
    def saturated_fraction(self) -> float:
        """Share of the physics steps since the reset with a motor at its torque limit."""
        return self.servo.saturated_steps / self.steps if self.steps else 0.0


def _log_warning(text: str) -> None:
    _LOG.warning("MuJoCo: %s", text)
