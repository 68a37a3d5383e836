"""Plays a policy: sees frames, asks an engine, and turns answers into set-points and gaits."""

from collections import deque
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from typing import Any, NamedTuple

import numpy as np

from common.runtime.service import Inputs
from common.schemas import GaitReply, GaitRequest, PolicyMode
from common.topics import WBC_STATE
from services.policy.checkpoint.manifest import Description
from services.policy.configuration import ChunkConfig
from services.policy.processor.actions import Command
from services.policy.serving.config import PolicyConfig
from services.policy.serving.delay import measured_delay
from services.policy.serving.engine import Answer, Engine, Request
from services.policy.serving.gait_trigger import GaitTrigger
from services.policy.serving.observer import Frame, Observer, UnseenError
from services.policy.serving.plan import CLOSED, RESTING, Plan, Target

PERIOD_NS = 50_000_000
"""Frames and set-points at 20 Hz, as in the demonstrations."""
KEPT_FRAMES = 40
"""Frames kept for a memory that goes on while no answer comes."""


class _Asked(NamedTuple):
    """The request in flight: its step, when it was made [ns], and the set-point before it."""

    step: int
    at_ns: int
    previous: Command


@dataclass
class Figures:
    """What is published of a player; see :class:`common.schemas.PolicyState`."""

    delay: float = -1.0
    compensated: int = 0
    round_trip: float = -1.0
    inference: float = -1.0
    answers: int = 0
    late: int = 0
    unasked: int = 0
    unanswered: int = 0


class Player:
    """Plays a policy from one start to the next.

    Answers are matched to requests by the step that they carry. From one that comes late, what is
    past is left out; in the meantime the plan before goes on.

    Attributes:
        engine: computes the answers.
        observer: makes the frames.
        trigger: decides about gaits.
        figures: what is published.
        mode: what it is doing.
        unseen: why there is no frame in this step; empty: there is one.
        started: whether it plays.
    """

    def __init__(self, config: PolicyConfig, description: Description, engine: Engine) -> None:
        policy = description.manifest.policy
        self._config = config
        self._processor = description.processor
        self._memory_shape = policy.memory_shape
        self._execute, self._window = config.steps_of(policy), config.window_of(policy)
        self._chunked = isinstance(policy.actions, ChunkConfig)
        self._steps = policy.actions.shape[0]
        self.engine = engine
        self.observer = Observer(self._processor, config.stale_after)
        self.trigger = GaitTrigger(config.trigger, self._processor.hazard_frames, 1e-9 * PERIOD_NS)
        self.figures = Figures()
        self._step = 0
        self.rest()

    def rest(self) -> None:
        """Forget plan, memory and request."""
        self.started = False
        self.mode = PolicyMode.WAITING
        self.unseen = ""
        self._plan, self._target = Plan(), RESTING
        self._memory = np.zeros(self._memory_shape, dtype=np.float32)
        self._frames: deque[tuple[int, Frame]] = deque(maxlen=self._window or KEPT_FRAMES)
        # The answer to a request that was made before is not asked for any more.
        self._asked: _Asked | None = None
        self._lost = False
        self._idle = 0

    def start(self, step: int, target: Target, first_id: int) -> None:
        """Begin in ``step`` at a target, with ids of gait requests from ``first_id`` on."""
        self.started, self._target = True, target
        self.trigger.begin(step, first_id)

    def skip(self) -> None:
        """Let a step pass in which it does not play; answers that come are not asked for."""
        self.figures.unasked += len(self.engine.answers())

    def play(
        self, step: int, inputs: Inputs, replies: Iterable[GaitReply], now_ns: int
    ) -> tuple[Target, GaitRequest | None]:
        """Return the set-point of ``step``, and a gait request if it is time for one.

        Args:
            step: number of the step, one more than that before.
            inputs: of the service.
            replies: to own gait requests.
            now_ns: the runner's clock [ns].
        """
        self._step = step
        controller = inputs.latest(WBC_STATE)
        if controller is not None:
            self.trigger.update(step, controller, replies)
        self._see(inputs)
        request = self._take_answers(now_ns)
        if self._is_due(now_ns):
            self._ask(inputs, now_ns)
            request = self._take_answers(now_ns) or request
        self._idle = 0 if self._plan else self._idle + 1
        if self._plan:
            self._target = self._plan.take()
        self.mode = self._mode(now_ns)
        return self._target, request

    def report(self) -> dict[str, Any]:
        """Return fields of the policy's state."""
        return asdict(self.figures) | {
            "mode": self.mode,
            "picture_age": self.observer.picture_age,
            "refused": self.engine.refused,
            "gaits": self.trigger.requested,
        }

    def _see(self, inputs: Inputs) -> None:
        """Keep the frame of this step."""
        try:
            frame = self.observer.see(inputs, self._target.command)
        except UnseenError as error:
            self.unseen = str(error)
            return
        self.unseen = ""
        if not self._window and len(self._frames) == KEPT_FRAMES:
            # The memory has missed too much to go on.
            self._memory = np.zeros(self._memory_shape, dtype=np.float32)
            self._frames.clear()
        self._frames.append((self._step, frame))

    def _is_due(self, now_ns: int) -> bool:
        """Return whether to ask now: there is a frame, the plan is worn, no request is open."""
        if self._asked is not None:
            waited = 1e-9 * (now_ns - self._asked.at_ns)
            overdue = waited > self._config.answer_timeout
            if overdue or not self.engine.waiting:
                # While nobody is there, the vain requests of every step do not count.
                self.figures.unanswered += overdue or not self._lost
                self._asked, self._lost = None, True
        # On a slow link it asks sooner, so that the answer comes before the plan has run out.
        left = len(self._plan) * PERIOD_NS > 1e9 * max(0.0, self.figures.round_trip)
        worn = not left or self._plan.executed >= self._execute
        return worn and self._asked is None and not self.unseen

    def _ask(self, inputs: Inputs, now_ns: int) -> None:
        figures = self.figures
        if self._chunked:
            figures.delay = measured_delay(inputs)
            steps = round(figures.delay * 1e9 / PERIOD_NS) if self._config.compensate else 0
            figures.compensated = min(max(0, steps), self._steps - self._execute)
        frames = [frame for _, frame in self._frames]
        request = Request(
            self._step,
            np.stack([frame.observation for frame in frames]),
            np.stack([frame.pictures for frame in frames]),
            self._memory,
        )
        self._asked = _Asked(self._step, now_ns, self._target.command)
        self.engine.ask(request)

    def _take_answers(self, now_ns: int) -> GaitRequest | None:
        """Make the answer to the open request the plan; drop and count all others."""
        request: GaitRequest | None = None
        for answer in self.engine.answers():
            if self._asked is None or answer.step != self._asked.step:
                self.figures.unasked += 1
                continue
            asked, self._asked, self._lost = self._asked, None, False
            self.figures.round_trip = 1e-9 * (now_ns - asked.at_ns)
            self.figures.inference = answer.seconds
            self.figures.answers += 1
            self._follow(answer, asked)
            request = self.trigger.decide(answer.decision.gait, asked.step)
        return request

    def _follow(self, answer: Answer, asked: _Asked) -> None:
        if not self._window:
            self._memory = answer.memory
            while self._frames and self._frames[0][0] <= answer.step:
                self._frames.popleft()
        targets = self._targets(answer, asked.previous)
        # Of one step nothing is past: it holds until the next.
        past = self._step - asked.step + self.figures.compensated if self._chunked else 0
        if not self._plan.replace(targets, past):
            self.figures.late += 1

    def _targets(self, answer: Answer, previous: Command) -> Sequence[Target]:
        commands = self._processor.commands(answer.decision, previous)
        closures = (answer.decision.grasp > CLOSED).astype(np.float64)
        return [Target(*pair) for pair in zip(commands, closures, strict=True)]

    def _mode(self, now_ns: int) -> PolicyMode:
        if self._idle * PERIOD_NS > 1e9 * self._config.hold_after:
            return PolicyMode.RECONNECTING if self._lost else PolicyMode.STARVED
        waited = 0 if self._asked is None else now_ns - self._asked.at_ns
        late = max(1e-9 * waited, self.observer.picture_age) > self._config.late_after
        return PolicyMode.DEGRADED if late or self.unseen or self._idle > 1 else PolicyMode.OK
