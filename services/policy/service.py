"""A policy as a service: it operates the robot as a person or a script does."""

import logging
from collections import deque
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, Self

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
from services.policy.configuration import ChunkConfig
from services.policy.processor.actions import Command
from services.policy.serving.config import PolicyConfig
from services.policy.serving.delay import measured_delay
from services.policy.serving.engine import Answer, Engine, LocalEngine, Request
from services.policy.serving.gait_trigger import GaitTrigger
from services.policy.serving.observer import TOPICS, Frame, Observer, UnseenError
from services.policy.serving.plan import CLOSED, RESTING, Plan, Target

__all__ = ["PolicyConfig", "PolicyOperator"]

log = logging.getLogger(__name__)

PERIOD_NS = 50_000_000
"""Frames and set-points at 20 Hz, as in the demonstrations."""
STATE_STEPS = 4
"""Steps from one state message to the next."""
KEPT_FRAMES = 40
"""Frames kept for a memory that goes on while no answer comes."""


class _Asked(NamedTuple):
    """The request in flight: its step, when it was made [ns], and the set-point before it."""

    step: int
    at_ns: int
    previous: Command


class PolicyOperator(Service):
    """Operates the robot by a policy while it has the robot.

    It never takes the robot from anybody; a person takes it by claiming it, and the policy goes on
    when it is given back. It begins at the controller's target, so that nothing jumps, and forgets
    what it saw before. Without answers or without sight the hands hold; a gait in progress ends and
    the balance goes on, both by the controller alone.

    Attributes:
        failure: reason for which it did not begin; empty: it did, or still may.
        cameras: whose pictures it sees.
        mode: what it is doing.
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
            engine: computes the answers; None: torch in this process.
            description: of the checkpoint; None: it is read.

        Raises:
            CheckpointError: the checkpoint cannot be served.
            PolicyError: torch cannot run it on the device that is configured.
        """
        self.config = config
        if engine is None:
            engine, description = local_engine(config)
            # Other engines have inputs outside the bus.
            self.settings = config.model_dump(mode="json")
        self._description = description or describe(config.checkpoint, config.kind)
        policy = self._description.manifest.policy
        self._engine = engine
        self._processor = self._description.processor
        self._memory_shape = policy.memory_shape
        self._execute, self._window = config.steps_of(policy), config.window_of(policy)
        self._chunked = isinstance(policy.actions, ChunkConfig)
        self._steps = policy.actions.shape[0]
        self.cameras = policy.inputs.cameras
        self._observer = Observer(self._processor, config.stale_after)
        self.reads = (*self._observer.topics, WBC_AUTHORITY, WBC_TARGET, WBC_REPLY)
        self._claimant = Claimant(OperatorKind.POLICY)
        self._trigger = GaitTrigger(config.trigger, self._processor.hazard_frames, 1e-9 * PERIOD_NS)
        self.failure = ""
        self._step = self._first_ns = -1
        self._resets = 0
        self._answers = self._late = self._unasked = self._unanswered = 0
        self._round_trip = self._inference = self._delay = -1.0
        self._skipped = 0
        self._shown_mode: PolicyMode | None = None
        self._shown_step = 0
        self._asked: _Asked | None = None
        self._rest()

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the policy for a replay; its checkpoint must be where it was."""
        return cls(validated(PolicyConfig, settings))

    def _rest(self) -> None:
        """Forget plan, memory and request: the next start is from the controller's target."""
        self._acting = False
        self._plan = Plan()
        self._target = RESTING
        self._memory = np.zeros(self._memory_shape, dtype=np.float32)
        self._frames: deque[tuple[int, Frame]] = deque(maxlen=self._window or KEPT_FRAMES)
        # An answer to a request that was made before is not asked for any more.
        self._asked = None
        self._lost = False
        self._idle = 0
        self._unseen = ""
        self.mode = PolicyMode.WAITING

    @property
    def note(self) -> str:
        """What it does or waits for."""
        if self.failure:
            return self.failure
        if not self._claimant.has_robot:
            return f"waiting: {self._claimant.waits_for()}"
        if not self._acting:
            return f"waiting: {self._unseen or 'no BALANCE seen'}"
        if self.mode is PolicyMode.OK:
            return "acting"
        reason = self._unseen or self._engine.problem
        return f"{self.mode.name.lower()}: {reason or 'no answer in time'}"

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
            self._take_answers(now_ns)
        return [*outputs, *self._report(inputs, stamp)]

    def close(self) -> None:
        """Let go of the engine."""
        self._engine.close()

    def _may_act(self, inputs: Inputs, state: PlantState | None, now_ns: int) -> bool:
        """Return whether it has the robot and has begun; begin if it may."""
        if state is not None and state.reset_count != self._resets:
            self._resets = state.reset_count
            self._rest()
        if not self._claimant.has_robot:
            if self._acting:
                self._rest()
            self._check_patience(now_ns)
            return False
        if self._acting:
            return True
        controller, target = inputs.latest(WBC_STATE), inputs.latest(WBC_TARGET)
        ready = controller is not None and controller.state is ControlState.BALANCE
        if target is None or not ready:
            self._check_patience(now_ns)
            return False
        self._acting, self._target = True, _as_target(target)
        self._trigger.begin(self._step, now_ns // 1_000_000)
        return True

    def _check_patience(self, now_ns: int) -> None:
        """Fail if it could not begin in time."""
        waited = 1e-9 * (now_ns - self._first_ns)
        if self.config.stay or self._answers or waited < self.config.start_timeout:
            return
        self.failure = f"not begun within {self.config.start_timeout:g} s: {self.note}"
        log.error("policy: %s", self.failure)
        self._claimant.release()
        self.exit_code = 1

    def _act(
        self, inputs: Inputs, replies: Sequence[GaitReply], now_ns: int, stamp: int
    ) -> list[Output]:
        """Return the set-point of this step, and a gait request if it is time for one."""
        controller = inputs.latest(WBC_STATE)
        assert controller is not None
        self._trigger.update(self._step, controller, replies)
        self._see(inputs)
        outputs = self._take_answers(now_ns)
        if self._is_due(now_ns):
            self._ask(inputs, now_ns)
            outputs += self._take_answers(now_ns)
        self._idle = 0 if self._plan else self._idle + 1
        if self._plan:
            self._target = self._plan.take()
        self.mode = self._mode(now_ns)
        return [Output(TELEOP_SETPOINT, self._target.setpoint(stamp)), *outputs]

    def _see(self, inputs: Inputs) -> None:
        """Keep the frame of this step."""
        try:
            frame = self._observer.see(inputs, self._target.command)
        except UnseenError as error:
            self._unseen = str(error)
            return
        self._unseen = ""
        if not self._window and len(self._frames) == KEPT_FRAMES:
            # The memory has missed too much to go on.
            self._memory = np.zeros(self._memory_shape, dtype=np.float32)
            self._frames.clear()
        self._frames.append((self._step, frame))

    def _is_due(self, now_ns: int) -> bool:
        """Return whether to ask now: the frame is there, the plan worn, and no request open."""
        if self._asked is not None and now_ns - self._asked.at_ns > self._timeout_ns:
            self._unanswered += 1
            self._asked, self._lost = None, True
        # On a slow link it asks sooner, so that the answer comes before the plan has run out.
        left = len(self._plan) * PERIOD_NS > 1e9 * max(0.0, self._round_trip)
        worn = not left or self._plan.executed >= self._execute
        return worn and self._asked is None and not self._unseen

    @property
    def _timeout_ns(self) -> int:
        return round(1e9 * self.config.answer_timeout)

    def _ask(self, inputs: Inputs, now_ns: int) -> None:
        if self._chunked:
            self._delay = measured_delay(inputs)
            wanted = max(0, round(self._delay * 1e9 / PERIOD_NS)) if self.config.compensate else 0
            self._skipped = min(wanted, self._steps - self._execute)
        frames = [frame for _, frame in self._frames]
        self._asked = _Asked(self._step, now_ns, self._target.command)
        self._engine.ask(
            Request(
                self._step,
                np.stack([frame.observation for frame in frames]),
                np.stack([frame.pictures for frame in frames]),
                self._memory,
            )
        )

    def _take_answers(self, now_ns: int) -> list[Output]:
        """Make the answer to the open request the plan; drop and count all others."""
        outputs: list[Output] = []
        for answer in self._engine.answers():
            if self._asked is None or answer.step != self._asked.step:
                self._unasked += 1
                continue
            asked, self._asked, self._lost = self._asked, None, False
            self._round_trip = 1e-9 * (now_ns - asked.at_ns)
            self._inference = answer.seconds
            outputs += self._take(answer, asked)
        return outputs

    def _take(self, answer: Answer, asked: _Asked) -> list[Output]:
        self._answers += 1
        if not self._window:
            self._memory = answer.memory
            while self._frames and self._frames[0][0] <= answer.step:
                self._frames.popleft()
        decision = answer.decision
        closures = (decision.grasp > CLOSED).astype(np.float64)
        commands = self._processor.commands(decision, asked.previous)
        targets = [Target(*pair) for pair in zip(commands, closures, strict=True)]
        # One-step answers hold until the next; only of a chunk are the first steps past.
        passed = self._step - asked.step + self._skipped if self._chunked else 0
        if not self._plan.replace(targets, passed):
            self._late += 1
        request = self._trigger.decide(decision.gait, asked.step)
        return [] if request is None else [Output(TELEOP_GAIT, request)]

    def _mode(self, now_ns: int) -> PolicyMode:
        if self._idle * PERIOD_NS > 1e9 * self.config.hold_after:
            return PolicyMode.RECONNECTING if self._lost else PolicyMode.STARVED
        waited = 0 if self._asked is None else now_ns - self._asked.at_ns
        late = max(1e-9 * waited, self._observer.picture_age) > self.config.late_after
        return PolicyMode.DEGRADED if late or self._unseen or self._idle > 1 else PolicyMode.OK

    def _report(self, inputs: Inputs, stamp: int) -> list[Output]:
        """Return the state at 5 Hz and at every change of the mode."""
        changed = self.mode is not self._shown_mode
        if not changed and self._step - self._shown_step < STATE_STEPS:
            return []
        self._shown_mode, self._shown_step = self.mode, self._step
        manifest = self._description.manifest
        age = inputs.age(PLANT_STATE)
        state = PolicyState(
            header=Header(stamp=stamp),
            policy=manifest.policy.kind,
            checkpoint=self._description.digest,
            mode=self.mode,
            label=self.note[:200],
            state_age=age if np.isfinite(age) else -1.0,
            picture_age=self._observer.picture_age,
            delay=self._delay,
            compensated=self._skipped,
            round_trip=self._round_trip,
            inference=self._inference,
            answers=self._answers,
            late=self._late,
            unasked=self._unasked,
            refused=self._engine.refused,
            unanswered=self._unanswered,
            gaits=self._trigger.requested,
        )
        return [Output(POLICY_STATE, state)]


def _as_target(setpoint: Setpoint) -> Target:
    """Return the controller's target, as the columns of an episode would have it."""
    columns = action(setpoint)
    command = Command(np.asarray(columns["action/hands"]), float(setpoint.neck_pitch))
    return Target(command, setpoint.gripper_closure)


def local_engine(config: PolicyConfig) -> tuple[Engine, Description]:
    """Return an engine that computes with torch in this process, warmed up.

    Raises:
        CheckpointError: the checkpoint cannot be served.
        PolicyError: the device that is configured is not there.
    """
    from services.policy.networks.runtime import load_runtime

    runtime, description = load_runtime(
        config.checkpoint, config.kind, config.device, config.threads
    )
    runtime.warm_up(max(1, config.window_of(description.manifest.policy)))
    return LocalEngine(runtime), description
