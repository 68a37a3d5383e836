"""Which of several operators has the robot: decided by their claims and robot time; pure.

At most one has it, for as long as its claims arrive. A deliberate act takes the robot from an
operator of lower rank, and a person's act also from another person. After an accident, which is an
emergency stop or the silence of a person who had the robot, a waiting operator does not get it by
itself.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum

from common.schemas import (
    NOBODY,
    AuthorityChange,
    AuthorityState,
    Header,
    OperatorClaim,
    Sender,
)
from common.schemas import OperatorKind as Kind
from services.wbc.config import AuthorityConfig

_MAX_WAITING = 64


class _Bar(Enum):
    """Who may get a free robot without a new deliberate act."""

    OPEN = 0
    """Whoever wants it."""
    LEFT = 1
    """A person fell silent: the same operator when it comes back, or another person."""
    STOPPED = 2
    """An emergency stop: nobody."""


@dataclass
class _Claimant:
    """What is known of one run of an operator."""

    claim: OperatorClaim
    heard: int  # robot time at which it came [ns]
    asked: int  # numbers operators in the order in which they began to want the robot
    acted: bool  # whether the last update brought a deliberate act
    first: bool = True  # whether no claim has come since the first


class Authority:
    """Decides who has the robot.

    A new controller does not know who had it. An operator that believes to have it gets it at once,
    anybody else after one lease, in which the former holder would have been heard.

    Attributes:
        holder: who has the robot; None: nobody.
        ignored: set-points and gait requests of others so far; counted by the caller.
    """

    def __init__(self, config: AuthorityConfig) -> None:
        self.holder: Sender | None = None
        self.ignored = 0
        self._lease = round(1e9 * config.lease)
        self._ranks = {Kind[name.upper()]: n for n, name in enumerate(config.ranks)}
        self._now = self._since = 0
        self._listen_until = -1
        self._claimants: dict[Sender, _Claimant] = {}
        self._asked = 0
        self._bar = _Bar.OPEN
        self._kind = Kind.POLICY
        self._count = 0
        self._change = AuthorityChange.NONE
        self._previous = NOBODY
        self._changes: list[AuthorityState] = []

    @property
    def state(self) -> AuthorityState:
        """The decision in force, as it is published."""
        holder = self.holder or NOBODY
        wanting = [sender for sender, claimant in self._claimants.items() if self._wants(claimant)]
        return AuthorityState(
            header=Header(stamp=self._now),
            holder=holder.source,
            holder_boot=holder.boot,
            kind=self._kind,
            changes=self._count,
            change=self._change,
            previous=self._previous.source,
            previous_boot=self._previous.boot,
            since=self._since,
            waiting=[s.source for s in wanting if s != holder][:_MAX_WAITING],
            ignored=self.ignored,
        )

    def update(
        self, now_ns: int, claims: Mapping[Sender, OperatorClaim], *, stopped: bool
    ) -> list[AuthorityState]:
        """Decide anew; return the changes, oldest first.

        Args:
            now_ns: robot time; it goes back when the plant is restarted.
            claims: the last claim of each operator, the most recent one last.
            stopped: whether an emergency stop is on.
        """
        self._advance(now_ns)
        self._hear(claims)
        self._changes = []
        if stopped:
            if self.holder is not None:
                self._give(None, AuthorityChange.STOPPED)
            self._bar = _Bar.STOPPED
        else:
            self._check_lease()
            if self._listening:
                self._resume()
            elif self.holder is None:
                self._grant()
            self._follow_acts()
        return self._changes

    @property
    def _listening(self) -> bool:
        return self._now < self._listen_until

    def _advance(self, now_ns: int) -> None:
        if self._listen_until < 0 or now_ns < self._now:
            # The first update, or another time scale.
            self._listen_until = now_ns if self._count else now_ns + self._lease
            for claimant in self._claimants.values():
                claimant.heard = now_ns
        self._now = now_ns

    def _hear(self, claims: Mapping[Sender, OperatorClaim]) -> None:
        """Note new claims; forget operators of which the inbox keeps none."""
        known, self._claimants = self._claimants, {}
        for sender, claim in claims.items():
            claimant, acts = known.get(sender), claim.kind is not Kind.POLICY
            if claimant is None:
                self._asked += 1
                claimant = _Claimant(claim, self._now, self._asked, acts and claim.act > 0)
            elif claim.header.seq == claimant.claim.header.seq:
                claimant.acted = False
            else:
                if claim.wants and not claimant.claim.wants:
                    self._asked += 1
                    claimant.asked = self._asked
                claimant.acted = acts and claim.act > claimant.claim.act
                claimant.claim, claimant.heard, claimant.first = claim, self._now, False
            self._claimants[sender] = claimant

    def _wants(self, claimant: _Claimant) -> bool:
        return claimant.claim.wants and self._now - claimant.heard <= self._lease

    def _check_lease(self) -> None:
        """Take the robot from a holder that fell silent or gave it back."""
        if self.holder is None:
            return
        claimant = self._claimants.get(self.holder)
        if claimant is None or self._now - claimant.heard > self._lease:
            self._give(None, AuthorityChange.EXPIRED)
            self._bar = _Bar.LEFT if self._kind is Kind.PERSON else _Bar.OPEN
        elif not claimant.claim.wants:
            self._give(None, AuthorityChange.RELEASED)

    def _follow_acts(self) -> None:
        """Give the robot to those who have just asked for it, in the order of their claims."""
        for sender, claimant in self._claimants.items():
            if not claimant.acted or not claimant.claim.wants or sender == self.holder:
                continue
            # A new controller cannot tell when the act of a first claim was.
            fresh = not (claimant.first and self._listening)
            persons = claimant.claim.kind is self._kind is Kind.PERSON
            if self.holder is None:
                if fresh:
                    self._give(sender, AuthorityChange.GRANTED)
            elif self._ranks[claimant.claim.kind] < self._ranks[self._kind] or (persons and fresh):
                self._give(sender, AuthorityChange.TAKEN)

    def _resume(self) -> None:
        """Give the robot to the operator that believes to have it, while this is not settled."""
        settled = self.holder is not None and self._change is not AuthorityChange.RESUMED
        if settled or self._bar is not _Bar.OPEN:
            return
        believers = [
            (self._ranks[claimant.claim.kind], sender.boot, sender)
            for sender, claimant in self._claimants.items()
            if claimant.claim.holding and self._wants(claimant)
        ]
        if believers and (best := min(believers)[-1]) != self.holder:
            self._give(best, AuthorityChange.RESUMED)

    def _grant(self) -> None:
        """Give a free robot to the waiting operator of the highest rank."""
        candidates = [
            (self._ranks[claimant.claim.kind], claimant.asked, sender)
            for sender, claimant in self._claimants.items()
            if self._wants(claimant) and self._open_to(sender, claimant)
        ]
        if candidates:
            self._give(min(candidates)[-1], AuthorityChange.GRANTED)

    def _open_to(self, sender: Sender, claimant: _Claimant) -> bool:
        if self._bar is _Bar.LEFT:
            return claimant.claim.kind is Kind.PERSON or sender.source == self._previous.source
        return self._bar is _Bar.OPEN

    def _give(self, holder: Sender | None, change: AuthorityChange) -> None:
        if self.holder is not None:
            self._previous = self.holder
        if holder is not None:
            self._kind, self._bar = self._claimants[holder].claim.kind, _Bar.OPEN
        self.holder, self._change = holder, change
        self._since, self._count = self._now, self._count + 1
        self._changes.append(self.state)
