"""What a service took in at each of its steps, so that it can be replayed and accounted for."""

from pydantic import BaseModel, ConfigDict, Field

from common.schemas.base import Message


class Stream(BaseModel):
    """One life of one publisher of one topic."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    topic: str = Field(max_length=64)
    source: str = Field(max_length=64)
    boot: int = Field(ge=0)


class StepJournal(Message):
    """A stretch of a service's life, a few times a second.

    ``steps`` and ``takes`` are tables of little-endian int64, row by row; their columns are in
    :mod:`common.journal.journal`. Of a sender heard for the first time ``payloads`` carries the
    bytes of what was taken in for some seconds, since a logger may not have been connected yet.
    """

    service: str = Field(max_length=64)
    first_step: int = Field(ge=0, description="number of the first step in `steps`, from 0")
    streams: list[Stream] = Field(max_length=64, description="whom `takes` refers to by number")
    steps: bytes = Field(max_length=4_000_000)
    takes: bytes = Field(max_length=16_000_000)
    payloads: bytes = Field(default=b"", max_length=32_000_000)
    settings: str = Field(
        default="",
        max_length=1_000_000,
        description="JSON from which the service can be built again; with the first step only",
    )
    lost: int = Field(
        default=0, ge=0, description="messages taken in since the life began but not noted"
    )
