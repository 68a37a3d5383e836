"""Claim of an operator to the robot, and its belief whether it has it; pure.

Every operator uses one: a person's, a script's or a policy's. The controller decides and says so
on ``wbc/authority``; an operator sends set-points and gait requests only while it has the robot.
"""

from collections.abc import Iterable
from typing import Final

from common.repeat import next_due_ns
from common.runtime.service import Inputs, Output
from common.schemas import (
    NOBODY,
    AuthorityChange,
    AuthorityState,
    GaitReply,
    Header,
    OperatorClaim,
    OperatorKind,
    Sender,
)
from common.topics import TELEOP_CLAIM, WBC_AUTHORITY

PATIENCE: Final = 3.0
"""Time after which a person's wish that was not granted is withdrawn [s]."""


class Claimant:
    """One operator's side of the question who has the robot.

    A script is started by a person, so that its start is a deliberate act; a policy never acts and
    only waits for a robot that is free. Both go on wanting the robot when they lose it. A person
    has to ask again each time, so that the robot does not come back to somebody who has turned
    away.

    Attributes:
        kind: of operator.
        wants: whether it asks for the robot or keeps it.
        acts: deliberate acts so far.
        authority: what the controller last said; None: nothing yet.
        asked: time since which a person has been asking [s]; None: it is not.
    """

    def __init__(self, kind: OperatorKind) -> None:
        """Start without the robot; a script and a policy want it at once."""
        self.kind = kind
        self.wants = kind is not OperatorKind.PERSON
        self.acts = 1 if kind is OperatorKind.SCRIPT else 0
        self.authority: AuthorityState | None = None
        self.asked: float | None = None
        self._own = NOBODY
        self._believes = False
        self._left: AuthorityState | None = None
        self._sent: OperatorClaim | None = None
        self._due_ns = 0

    @property
    def has_robot(self) -> bool:
        """Whether the controller follows this operator, as far as it knows."""
        return self._believes and self.wants

    @property
    def holder(self) -> str:
        """The other operator that has the robot, in words; empty if there is none."""
        state = self.authority
        if state is None or not state.holder or state.holder_boot == self._own.boot:
            return ""
        return f"another {state.holder}" if state.holder == self._own.source else state.holder

    def update(self, inputs: Inputs, own: Sender, *, stopped: bool) -> None:
        """Take in what the controller says.

        Args:
            inputs: of the operator; read is ``wbc/authority``.
            own: the operator's own run.
            stopped: whether the plant is seen to be stopped, which ends everybody's hold.
        """
        self._own, had = own, self._believes
        said = inputs.latest(WBC_AUTHORITY)
        # Each message counts once: an old one must not give the robot back after a stop.
        if said is not None and said is not self.authority:
            self.authority = said
            # A controller that has just been started knows of nobody, and learns it from claims.
            if said.change is not AuthorityChange.NONE:
                holds = bool(said.holder) and said.holder_boot == own.boot
                self._believes = holds and not self._is_outdated(said)
        if stopped:
            self._believes = False
        if self._believes:
            self.asked = None
        elif had and self.kind is OperatorKind.PERSON:
            self.wants = False

    def ask(self, now: float) -> None:
        """Ask for the robot by a deliberate act, of a person or in one's place, at ``now`` [s]."""
        self.acts, self.wants, self.asked = self.acts + 1, True, now

    def give_up(self, now: float) -> bool:
        """Withdraw a person's wish that was not granted in time; returns whether it was."""
        if self.asked is None or self.has_robot or now - self.asked < PATIENCE:
            return False
        self.release()
        return True

    def release(self) -> None:
        """Give the robot back, or cease to ask for it: whoever waits may have it."""
        self.wants, self.asked = False, None
        # What was said before it was heard of: word of it is still under way on a slow link, and
        # must not count for the next time, nor the end of it take that away.
        self._believes, self._left = False, self.authority

    def claims(self, now_ns: int, stamp: int) -> list[Output]:
        """Return the claim at 10 Hz and at each change; ``stamp`` is the last robot time [ns]."""
        claim = OperatorClaim(
            kind=self.kind, wants=self.wants, act=self.acts, holding=self.has_robot
        )
        if claim == self._sent and now_ns < self._due_ns:
            return []
        self._sent, self._due_ns = claim, next_due_ns(now_ns)
        return [Output(TELEOP_CLAIM, claim.model_copy(update={"header": Header(stamp=stamp)}))]

    def _is_outdated(self, said: AuthorityState) -> bool:
        """Return whether the controller says what it said when the robot was given back."""
        left = self._left
        same_run = left is not None and left.header.boot == said.header.boot
        return left is not None and same_run and said.changes <= left.changes

    def waits_for(self) -> str:
        """Return in words why it does not have the robot."""
        state = self.authority
        if state is None:
            return "the controller has not said who has the robot"
        if self.holder:
            return f"{self.holder} has the robot"
        return f"nobody has the robot ({state.reason})"


def own_replies(replies: Iterable[GaitReply], boot: int) -> list[GaitReply]:
    """Return the replies to an operator's own gait requests, and those to an unknown sender."""
    return [reply for reply in replies if reply.requester_boot in (0, boot)]
