"""The header every message carries and the base class of all messages."""

from typing import Annotated, ClassVar, Final, NamedTuple

from pydantic import BaseModel, ConfigDict, Field

Count = Annotated[int, Field(ge=0, lt=2**63)]
"""Fits the signed 64-bit columns of journals, unlike every integer on the wire."""


class Sender(NamedTuple):
    """One run of a service: two processes of one name are two senders."""

    source: str
    boot: int


NOBODY: Final = Sender("", 0)
"""Stands for a sender where there is none."""


class Header(BaseModel):
    """Number, times and sender of a message.

    The service fills ``stamp``; the publisher fills everything else when it sends, also
    ``captured`` (with the start of the step) if the service has left it at 0.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    ALWAYS_SENT: ClassVar[frozenset[str]] = frozenset(
        {"seq", "stamp", "captured", "sent", "encode", "boot", "source", "injected"}
    )
    """Fields that every header has on the wire, so that their defaults make them optional only in
    Python; a field that is added later does not belong here."""

    seq: Count = Field(default=0, description="Counts this publisher's messages from 0")
    stamp: Count = Field(default=0, description="Robot time [ns] of the information in the message")
    captured: Count = Field(
        default=0, description="Sender's monotonic clock [ns] when the information came in"
    )
    sent: Count = Field(default=0, description="Sender's monotonic clock [ns] when sent")
    encode: Count = Field(default=0, description="Time [ns] spent encoding, before `sent`")
    boot: Count = Field(default=0, description="Random id of the sending process")
    source: str = Field(default="", max_length=64, description="Name of the sending service")
    injected: Count = Field(default=0, description="Delay deliberately injected on this link [ns]")

    @property
    def sender(self) -> Sender:
        """Who sent the message."""
        return Sender(self.source, self.boot)


class Message(BaseModel):
    """Base of all messages: frozen, no unknown fields, no NaN or infinity anywhere."""

    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False
    )

    VERSION: ClassVar[int] = 1
    """Part of the schema's identity: raise it when a field changes its meaning but not its type."""
    ALWAYS_SENT: ClassVar[frozenset[str]] = frozenset({"header"})
    """Fields that are required on the wire although they have a default."""

    header: Header = Header()
