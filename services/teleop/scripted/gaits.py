"""Client for gait requests: answer, retry and completion over links with loss and delay.

A request that is sent again without an answer keeps its id, so that the controller can recognise
it; after a refusal a new request gets a new id. The controller's state counts as an answer too, so
that a lost reply does not end a script. A controller that was restarted is sent the request once
more: it answers that it cannot know what became of the gait.
"""

from collections.abc import Generator, Iterator, Sequence
from dataclasses import dataclass, field

from pydantic import BaseModel, ConfigDict, Field

from common.schemas import ControllerState, ControlState, Gait, GaitOutcome, GaitReply, GaitRequest
from services.teleop.errors import ScriptError


class GaitPatience(BaseModel):
    """Timeouts and retries of gait requests."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    reply_timeout: float = Field(
        default=2.0,
        gt=0.0,
        description="time without an answer after which a request is sent again [s]",
    )
    resends: int = Field(default=3, ge=0, description="largest number of repetitions of a request")
    refusal_pause: float = Field(
        default=0.5, ge=0.0, description="between a refusal and the next request [s]"
    )
    refusals: int = Field(default=10, ge=1, description="of one gait after which the script fails")
    completion_timeout: float = Field(
        default=30.0, gt=0.0, description="from acceptance to completion [s]"
    )
    balance_grace: float = Field(
        default=2.0,
        gt=0.0,
        description="time in BALANCE with one more gait completed that replaces a lost reply [s]",
    )


@dataclass
class GaitClient:
    """Handles one gait request at a time.

    Attributes:
        patience: timeouts and retries.
        next_id: id of the next request; later ids are larger.
        dt: time since the last tick [s].
        replies: received in this tick.
        controller: the controller's last state if it is fresh, else None.
        controller_boot: id of the run of the controller that was last seen; 0: none was.
        completed: gaits that this run has completed so far; None: unknown.
        outbox: requests to publish after this tick.
    """

    patience: GaitPatience = field(default_factory=GaitPatience)
    next_id: int = 0
    dt: float = 0.0
    replies: Sequence[GaitReply] = ()
    controller: ControllerState | None = None
    controller_boot: int = 0
    completed: int | None = None
    outbox: list[GaitRequest] = field(default_factory=list)

    def update(
        self, dt: float, replies: Sequence[GaitReply], controller: ControllerState | None
    ) -> None:
        """Take in the time, the replies and the controller state of one tick."""
        self.dt, self.replies, self.controller = dt, replies, controller
        if controller is not None and controller.header.boot != self.controller_boot:
            # Another run counts its gaits anew.
            self.controller_boot, self.completed = controller.header.boot, None

    def perform(self, gait: Gait) -> Iterator[None]:
        """Request ``gait`` until it is accepted, then wait for its end; yields once a tick.

        Raises:
            ScriptError: the gait was refused too often, not answered, aborted, or not completed in
                time.
        """
        for refusal in range(1, self.patience.refusals + 1):
            refused = yield from self._request(gait)
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

    def _request(self, gait: Gait) -> Generator[None, None, str | None]:
        """Send one request; returns None when the gait is completed, else the refusal's reason."""
        request = GaitRequest(
            request_id=self.next_id, gait=gait, controller_boot=self.controller_boot
        )
        self.next_id += 1
        if self.controller is not None:
            # The state may be older than the last reply, which counted one more gait.
            self.completed = max(self.completed or 0, self.controller.gaits_completed)
        pending = PendingRequest(request, self.completed)
        while True:
            if pending.wants_sending(self.patience):
                self.outbox.append(request)
            yield
            outcome = pending.poll(self)
            if outcome is GaitOutcome.COMPLETED:
                if self.completed is not None:
                    self.completed += 1
                return None
            if outcome is GaitOutcome.REFUSED:
                return pending.reason


class PendingRequest:
    """A request and what is known about it."""

    def __init__(self, request: GaitRequest, completed_before: int | None) -> None:
        self.request = request
        self.name = request.gait.name.lower()
        self.completed_before = completed_before
        self.controller_boot = request.controller_boot
        self.reason = ""
        self.accepted = False
        self.sent = 0
        self.waited = 0.0
        self.balancing = 0.0

    def wants_sending(self, patience: GaitPatience) -> bool:
        """Return whether the request must be sent (again) now.

        Raises:
            ScriptError: it was sent too often.
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

    def poll(self, client: GaitClient) -> GaitOutcome | None:
        """Return the outcome of the request; None while it is open.

        Raises:
            ScriptError: the gait was aborted or takes too long.
        """
        self.waited += client.dt
        for reply in client.replies:
            if reply.request_id == self.request.request_id:
                # A refusal after acceptance answers a second copy of the request.
                if reply.outcome is GaitOutcome.REFUSED and self.accepted:
                    continue
                outcome = self._take(reply)
                if outcome is not None:
                    return outcome
        if client.controller is not None:
            self._watch(client.controller, client)
        if self.balancing >= client.patience.balance_grace:
            return GaitOutcome.COMPLETED
        if self.accepted and self.waited > client.patience.completion_timeout:
            raise ScriptError(
                f"{self.name} was accepted but not completed within "
                f"{client.patience.completion_timeout:g} s"
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

    def _watch(self, state: ControllerState, client: GaitClient) -> None:
        """Infer lost replies, and a restart of the controller, from its state."""
        if client.controller_boot != self.controller_boot:
            self.controller_boot = client.controller_boot
            self.accepted, self.sent, self.balancing = False, 0, 0.0
            return
        before = self.completed_before
        one_more = before is not None and state.gaits_completed > before
        if self.waited >= client.patience.reply_timeout:
            walking = state.gait is self.request.gait
            if walking or one_more:
                self._accept()
        at_rest = state.state is ControlState.BALANCE and state.gait is Gait.NONE
        self.balancing = (
            self.balancing + client.dt if self.accepted and at_rest and one_more else 0.0
        )
