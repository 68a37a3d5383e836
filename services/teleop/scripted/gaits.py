"""Asking for gaits: request, answer, retry and completion, over links that lose and delay.

A request keeps its id when it is sent again for want of an answer, so a controller that saw the
first copy can tell; after a refusal a new request with a new id is made. What the controller's
state shows counts as an answer too, so that one lost reply does not end a script.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, Field

from common.schemas import ControllerState, ControlState, Gait, GaitOutcome, GaitReply, GaitRequest
from services.teleop.errors import ScriptError


class GaitPatience(BaseModel):
    """How long and how often the operator tries."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    reply_timeout: float = Field(default=2.0, gt=0.0, description="then sent again [s]")
    resends: int = Field(default=3, ge=0, description="of one request without an answer")
    refusal_pause: float = Field(default=0.5, ge=0.0, description="before asking again [s]")
    refusals: int = Field(default=10, ge=1, description="of one gait before giving up")
    completion_timeout: float = Field(default=30.0, gt=0.0, description="after acceptance [s]")
    balance_grace: float = Field(
        default=2.0,
        gt=0.0,
        description="balancing this long, one gait more completed: the reply was lost [s]",
    )


@dataclass
class GaitClient:
    """Holds one conversation with the controller at a time.

    Attributes:
        patience: timeouts and retries.
        next_id: id of the next request; later ids are larger.
        dt: time since the last tick [s].
        replies: replies heard this tick.
        controller: the controller's last state if it is fresh, else None.
        completed: gaits the controller has completed, as far as is known here.
        outbox: requests to publish after this tick.
    """

    patience: GaitPatience = field(default_factory=GaitPatience)
    next_id: int = 0
    dt: float = 0.0
    replies: Sequence[GaitReply] = ()
    controller: ControllerState | None = None
    completed: int | None = None
    outbox: list[GaitRequest] = field(default_factory=list)

    def hear(
        self, dt: float, replies: Sequence[GaitReply], controller: ControllerState | None
    ) -> None:
        """Take in what one tick brought."""
        self.dt, self.replies, self.controller = dt, replies, controller

    def perform(self, gait: Gait) -> Iterator[None]:
        """Ask for ``gait`` until it is accepted, then wait for its end; yields once a tick.

        Raises:
            ScriptError: refused too often, never answered, aborted, or not completed in time.
        """
        for refusal in range(1, self.patience.refusals + 1):
            refused = yield from self._converse(gait)
            if refused is None:
                return
            if refusal < self.patience.refusals:
                yield from self._pause(self.patience.refusal_pause)
        raise ScriptError(
            f"{gait.name.lower()} was refused {self.patience.refusals} times: {refused}"
        )

    def _pause(self, seconds: float) -> Iterator[None]:
        elapsed = 0.0
        while elapsed < seconds:
            yield
            elapsed += self.dt

    def _converse(self, gait: Gait) -> Generator[None, None, str | None]:
        """One request; returns None when the gait was completed, else why it was refused."""
        request = GaitRequest(request_id=self.next_id, gait=gait)
        self.next_id += 1
        if self.controller is not None:
            # The state may be older than the last reply, which counted one gait more.
            self.completed = max(self.completed or 0, self.controller.gaits_completed)
        talk = PendingRequest(request, self.completed)
        while True:
            if talk.wants_sending(self.patience):
                self.outbox.append(request)
            yield
            outcome = talk.listen(self)
            if outcome is GaitOutcome.COMPLETED:
                if self.completed is not None:
                    self.completed += 1
                return None
            if outcome is GaitOutcome.REFUSED:
                return talk.reason


class PendingRequest:
    """One request and what has been heard about it."""

    def __init__(self, request: GaitRequest, completed_before: int | None) -> None:
        self.request = request
        self.name = request.gait.name.lower()
        self.completed_before = completed_before
        self.reason = ""
        self.accepted = False
        self.sent = 0
        self.waited = 0.0
        self.balancing = 0.0

    def wants_sending(self, patience: GaitPatience) -> bool:
        """Whether the request is due (again) now.

        Raises:
            ScriptError: it was sent often enough.
        """
        if self.accepted or (self.sent and self.waited < patience.reply_timeout):
            return False
        if self.sent > patience.resends:
            raise ScriptError(
                f"{self.name} was asked for {self.sent} times, {patience.reply_timeout:g} s apart, "
                "without an answer; is the controller running?"
            )
        self.sent += 1
        self.waited = 0.0
        return True

    def listen(self, desk: GaitClient) -> GaitOutcome | None:
        """What became of the request by this tick; None while that is open.

        Raises:
            ScriptError: the gait was aborted or takes too long.
        """
        self.waited += desk.dt
        for reply in desk.replies:
            if reply.request_id == self.request.request_id:
                # A refusal after acceptance answers a second copy of the request.
                if reply.outcome is GaitOutcome.REFUSED and self.accepted:
                    continue
                outcome = self._take(reply)
                if outcome is not None:
                    return outcome
        if desk.controller is not None:
            self._watch(desk.controller, desk)
        if self.balancing >= desk.patience.balance_grace:
            return GaitOutcome.COMPLETED
        if self.accepted and self.waited > desk.patience.completion_timeout:
            raise ScriptError(
                f"{self.name} was accepted but not completed within "
                f"{desk.patience.completion_timeout:g} s"
            )
        return None

    def _take(self, reply: GaitReply) -> GaitOutcome | None:
        self.reason = reply.reason or "no reason given"
        if reply.outcome is GaitOutcome.ABORTED:
            raise ScriptError(f"{self.name} was aborted: {self.reason}")
        if reply.outcome is GaitOutcome.ACCEPTED:
            self._accept()
            return None
        return reply.outcome

    def _accept(self) -> None:
        if not self.accepted:
            self.accepted, self.waited = True, 0.0

    def _watch(self, state: ControllerState, desk: GaitClient) -> None:
        """Make up for lost replies from the controller's state."""
        before = self.completed_before
        one_more = before is not None and state.gaits_completed > before
        if self.waited >= desk.patience.reply_timeout:
            walking = state.gait is self.request.gait
            if walking or one_more:
                self._accept()
        at_rest = state.state is ControlState.BALANCE and state.gait is Gait.NONE
        self.balancing = self.balancing + desk.dt if self.accepted and at_rest and one_more else 0.0
