"""Who had the robot when, from what the controller said on ``wbc/authority``; pure."""

from dataclasses import dataclass, replace

from common.schemas import AuthorityChange, AuthorityState, OperatorKind, Sender

_UNTIL = {
    AuthorityChange.NONE: "",
    AuthorityChange.GRANTED: "another operator got it",
    AuthorityChange.TAKEN: "it was taken",
    AuthorityChange.RELEASED: "it gave it back",
    AuthorityChange.EXPIRED: "it fell silent",
    AuthorityChange.STOPPED: "an emergency stop",
    AuthorityChange.RESUMED: "the controller was restarted",
}


@dataclass(frozen=True, slots=True)
class Hold:
    """A span in which one operator had the robot.

    Attributes:
        holder: the operator's run.
        kind: of the operator.
        start: when it got the robot, on the clock of whoever made the :class:`HoldBook`.
        intervention: whether it operated in place of a policy: it got the robot after one, or after
            another intervention.
        end: when it lost the robot; None: it has it.
        ended: why it lost it.
    """

    holder: Sender
    kind: OperatorKind
    start: float
    intervention: bool
    end: float | None = None
    ended: AuthorityChange = AuthorityChange.NONE

    @property
    def name(self) -> str:
        """The operator in words, for instance ``teleop (person)``."""
        return f"{self.holder.source} ({self.kind.name.lower()})"

    @property
    def until(self) -> str:
        """Why it lost the robot, in words; empty while it has it."""
        return _UNTIL[self.ended]

    def length(self, now: float) -> float:
        """Return how long it had the robot, until ``now`` if it has it still."""
        return (now if self.end is None else self.end) - self.start


class HoldBook:
    """Turns authority states, taken in in order, into holds; repeated states change nothing.

    Attributes:
        holds: in order; only the last one may go on.
    """

    def __init__(self) -> None:
        """Start before the first state."""
        self.holds: list[Hold] = []

    @property
    def present(self) -> Hold | None:
        """The hold that goes on; None: nobody has the robot."""
        return self.holds[-1] if self.holds and self.holds[-1].end is None else None

    @property
    def handover(self) -> str:
        """The last change in words if an intervention began or ended by it; otherwise empty."""
        present, last = self.present, self.holds[-1] if self.holds else None
        if present is not None and present.intervention:
            return f"{present.holder.source} takes over"
        if present is None:
            return f"{last.holder.source} lets go" if last and last.intervention else ""
        returned = len(self.holds) > 1 and self.holds[-2].intervention
        return f"back to {present.holder.source}" if returned else ""

    def observe(self, state: AuthorityState, at: float) -> bool:
        """Take in a state that came at ``at``; returns whether the robot changed hands."""
        present = self.present
        holder = Sender(state.holder, state.holder_boot) if state.holder else None
        if holder == (present.holder if present else None):
            return False
        if present is not None:
            self.holds[-1] = replace(present, end=at, ended=state.change)
        if holder is not None:
            self._begin(holder, state, at)
        return True

    def _begin(self, holder: Sender, state: AuthorityState, at: float) -> None:
        before = self.holds[-1] if self.holds else None
        resumed = state.change is AuthorityChange.RESUMED
        if before is not None and before.holder == holder and resumed:
            # The controller was restarted meanwhile; the operator had the robot all the time.
            self.holds[-1] = replace(before, end=None, ended=AuthorityChange.NONE)
            return
        in_place = before is not None and (
            before.intervention or before.kind is OperatorKind.POLICY
        )
        intervention = in_place and state.kind is not OperatorKind.POLICY
        self.holds.append(Hold(holder, state.kind, at, intervention))
