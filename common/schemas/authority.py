"""Who has the robot: the operators' claims and the controller's decision."""

from enum import IntEnum

from pydantic import Field

from common.schemas.base import Count, Message


class OperatorKind(IntEnum):
    """Kind of an operator, in rising rank unless configured otherwise."""

    POLICY = 0
    SCRIPT = 1
    PERSON = 2


class OperatorClaim(Message):
    """An operator's wish to have the robot.

    It is published at 10 Hz, not only when it changes, so that a lost message does no harm; the
    holder's claims renew its lease.
    """

    kind: OperatorKind
    wants: bool = Field(description="asks for the robot or keeps it; False releases it")
    act: Count = Field(
        description="counts the deliberate acts (clutch, key, start of a script) by which a person "
        "asked for the robot through this operator"
    )
    holding: bool = Field(
        description="believes that it has the robot; tells a controller that was restarted"
    )


class AuthorityChange(IntEnum):
    """Why the robot last changed hands."""

    NONE = 0
    """Nobody has had it yet."""
    GRANTED = 1
    """It was free, and the holder wanted it."""
    TAKEN = 2
    """A deliberate act took it from the previous holder."""
    RELEASED = 3
    """The previous holder gave it back."""
    EXPIRED = 4
    """The previous holder fell silent: its lease ran out."""
    STOPPED = 5
    """An emergency stop took it away."""
    RESUMED = 6
    """A restarted controller found that the holder had it."""


class AuthorityState(Message):
    """Who has the robot; published by the controller at 10 Hz and at every change."""

    holder: str = Field(max_length=64, description="source of the operator; empty: nobody")
    holder_boot: Count = Field(description="boot id of the holder; 0: nobody")
    kind: OperatorKind = Field(description="of the holder, or of the previous one if nobody has it")
    changes: int = Field(ge=0, description="times the robot changed hands so far")
    change: AuthorityChange = Field(description="why it last did")
    previous: str = Field(max_length=64, description="who had it before; empty: nobody")
    previous_boot: Count = Field(description="boot id of the previous holder")
    since: Count = Field(description="robot time of the last change [ns]")
    waiting: list[str] = Field(
        default_factory=list, max_length=64, description="sources that want it and do not have it"
    )
    ignored: int = Field(
        default=0, ge=0, description="set-points and gait requests of others, not followed so far"
    )

    @property
    def reason(self) -> str:
        """Why the robot last changed hands, in words."""
        previous = self.previous or "nobody"
        return {
            AuthorityChange.NONE: "nobody has had it yet",
            AuthorityChange.GRANTED: "it was free",
            AuthorityChange.TAKEN: f"taken from {previous}",
            AuthorityChange.RELEASED: f"{previous} gave it back",
            AuthorityChange.EXPIRED: f"{previous} fell silent",
            AuthorityChange.STOPPED: "an emergency stop took it away",
            AuthorityChange.RESUMED: "it had it before the controller was restarted",
        }[self.change]
