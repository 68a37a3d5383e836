"""A policy as a service: it operates the robot as a person or a script does."""

import logging
from collections.abc import Mapping, Sequence
from typing import Any, Self

import numpy as np

from common.episodes.observation import action
from common.operator.claim import Claimant, own_replies
from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    ControlState,
    GaitReply,
    GuardMode,
    Header,
    OperatorKind,
    PlantState,
    PolicyMode,
    PolicyState,
    Sender,
    Setpoint,
)
from common.tables import validated
from common.topics import (
    PLANT_STATE,
    POLICY_STATE,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.policy.checkpoint.manifest import Description, describe
from services.policy.processor.actions import Command
from services.policy.runtimes.load import load_runtime
from services.policy.serving.config import PolicyConfig
from services.policy.serving.engine import Engine, LocalEngine
from services.policy.serving.observer import TOPICS
from services.policy.serving.plan import Target
from services.policy.serving.player import PERIOD_NS, Player

__all__ = ["PolicyConfig", "PolicyOperator"]

log = logging.getLogger(__name__)

STATE_STEPS = 4
"""Steps from one state message to the next."""


class PolicyOperator(Service):
    """Operates the robot by a policy while it has the robot.

    It never takes the robot from anybody; a person takes it by claiming it, and the policy goes on
    when it is given back. It begins at the controller's target, so that nothing jumps, and forgets
    what it saw before. Without answers or without sight the hands hold; a gait in progress ends and
    the balance goes on, both by the controller alone.

    Attributes:
        failure: reason for which it did not begin; empty: it did, or still may.
        cameras: whose pictures it sees.
        engine: computes the answers.
    """

    name = "policy"
    period_ns = PERIOD_NS
    # Of what may be observed, only what the checkpoint wants is subscribed to.
    reads = (*TOPICS, WBC_AUTHORITY, WBC_TARGET, WBC_REPLY)
    writes = (TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT, POLICY_STATE)
    # A network on a busy core takes longer than a person's mapping.
    heartbeat_timeout_s = 0.5

    def __init__(
        self,
        config: PolicyConfig,
        engine: Engine | None = None,
        description: Description | None = None,
    ) -> None:
        """Prepare to run a checkpoint.

        Args:
            config: what to run, and how.
            engine: computes the answers; None: the configured runtime, in this process.
            description: of the checkpoint; None: it is read.

        Raises:
            CheckpointError: the checkpoint cannot be served.
            ConfigError: the runtime that is configured is not installed.
            PolicyError: it cannot run the policy on the device that is configured.
        """
        self.config = config
        if engine is None:
            engine, description = local_engine(config)
            # Other engines have inputs outside the bus, so that a log cannot reproduce them.
            self.settings = config.model_dump(mode="json")
        self._description = description or describe(config.checkpoint, config.kind)
        self.cameras = self._description.manifest.policy.inputs.cameras
        self.engine = engine
        self._player = Player(config, self._description, engine)
        self.reads = (*self._player.observer.topics, WBC_AUTHORITY, WBC_TARGET, WBC_REPLY)
        self._claimant = Claimant(OperatorKind.POLICY)
        self.failure = ""
        self._step = self._first_ns = -1
        self._resets = 0
        self._shown_mode: PolicyMode | None = None
        self._shown_step = 0

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the policy for a replay; its checkpoint must be where it was."""
        return cls(validated(PolicyConfig, settings))

    @property
    def mode(self) -> PolicyMode:
        """What it is doing."""
        return self._player.mode

    @property
    def note(self) -> str:
        """What it does or waits for, in words."""
        player = self._player
        if self.failure:
            return self.failure
        if not self._claimant.has_robot:
            return f"waiting: {self._claimant.waits_for()}"
        if not player.started:
            return "waiting: no BALANCE seen"
        if player.mode is PolicyMode.OK:
            return "acting"
        reason = player.unseen or self.engine.problem
        return f"{player.mode.name.lower()}: {reason or 'no answer in time'}"

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Observe, ask, and send the next set-point; see :class:`Service`."""
        self._step += 1
        if self._first_ns < 0:
            self._first_ns = now_ns
        state = inputs.latest(PLANT_STATE)
        stopped = state is not None and state.guard is GuardMode.ESTOP
        self._claimant.update(inputs, Sender(self.name, self.boot), stopped=stopped)
        stamp = 0 if state is None else state.header.stamp
        outputs = self._claimant.claims(now_ns, stamp)
        replies = own_replies(inputs.events(WBC_REPLY), self.boot)
        if self._may_act(inputs, state, now_ns):
            outputs += self._act(inputs, replies, now_ns, stamp)
        else:
            self._player.skip()
        return [*outputs, *self._report(inputs, stamp)]

    def after_step(self) -> None:
        """Let the network compute, once the set-point is on its way."""
        self.engine.work()

    def close(self) -> None:
        """Let go of the engine."""
        self.engine.close()

    def _may_act(self, inputs: Inputs, state: PlantState | None, now_ns: int) -> bool:
        """Return whether it has the robot and has begun; begin if it may."""
        player, resets = self._player, 0 if state is None else state.reset_count
        if resets != self._resets or not self._claimant.has_robot:
            self._resets = resets
            player.rest()
        if self._claimant.has_robot and not player.started:
            controller, target = inputs.latest(WBC_STATE), inputs.latest(WBC_TARGET)
            ready = controller is not None and controller.state is ControlState.BALANCE
            if ready and target is not None:
                player.start(self._step, _as_target(target), now_ns // 1_000_000)
        if not player.started:
            self._check_patience(now_ns)
        return player.started

    def _check_patience(self, now_ns: int) -> None:
        """Fail if it could not begin in time."""
        waited = 1e-9 * (now_ns - self._first_ns)
        begun = self.config.stay or self._player.figures.answers or self.failure
        if begun or waited < self.config.start_timeout:
            return
        self.failure = f"not begun within {self.config.start_timeout:g} s: {self.note}"
        log.error("policy: %s", self.failure)
        self._claimant.release()
        self.exit_code = 1

    def _act(
        self, inputs: Inputs, replies: Sequence[GaitReply], now_ns: int, stamp: int
    ) -> list[Output]:
        target, request = self._player.play(self._step, inputs, replies, now_ns)
        outputs = [Output(TELEOP_SETPOINT, target.setpoint(stamp))]
        if request is not None:
            header = Header(stamp=stamp)
            outputs.append(Output(TELEOP_GAIT, request.model_copy(update={"header": header})))
        return outputs

    def _report(self, inputs: Inputs, stamp: int) -> list[Output]:
        """Return the state at 5 Hz and at every change of the mode."""
        changed = self.mode is not self._shown_mode
        if not changed and self._step - self._shown_step < STATE_STEPS:
            return []
        self._shown_mode, self._shown_step = self.mode, self._step
        age = inputs.age(PLANT_STATE)
        state = PolicyState(
            header=Header(stamp=stamp),
            policy=self._description.manifest.policy.kind,
            checkpoint=self._description.digest,
            label=self.note[:200],
            state_age=age if np.isfinite(age) else -1.0,
            **self._player.report(),
        )
        return [Output(POLICY_STATE, state)]


def _as_target(setpoint: Setpoint) -> Target:
    """Return the controller's target, as the columns of an episode would have it."""
    hands = np.asarray(action(setpoint)["action/hands"])
    return Target(Command(hands, setpoint.neck_pitch), setpoint.gripper_closure)


def local_engine(config: PolicyConfig) -> tuple[Engine, Description]:
    """Return an engine that computes in this process, warmed up.

    Raises:
        ConfigError: the runtime that is configured is not installed.
        CheckpointError: the checkpoint cannot be served.
        PolicyError: the device that is configured is not there.
    """
    runtime, description = load_runtime(config)
    policy = description.manifest.policy
    return LocalEngine(runtime, config.inference_steps_of(policy)), description
