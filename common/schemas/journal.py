"""Inputs of each step of a service, for replay and for the latency ledger."""

from pydantic import BaseModel, ConfigDict, Field

from common.schemas.base import Message


class InputSource(BaseModel):
    """One publisher of one topic, from the start of its process to its end."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    topic: str = Field(max_length=64)
    source: str = Field(max_length=64)
    boot: int = Field(ge=0)
    schema_tag: str = Field(max_length=235, description="of its messages, as the sender names it")


class StepJournal(Message):
    """The steps of a service since its last journal message, published a few times a second.

    ``steps`` and ``inputs`` are tables of little-endian int64, row by row; their columns are in
    :mod:`common.journal.tables`. For a sender that is new, ``payloads`` carries the bytes of
    its messages for some seconds, since a logger may not have been connected yet.
    """

    service: str = Field(max_length=64)
    first_step: int = Field(ge=0, description="number of the first step in `steps`, from 0")
    sources: list[InputSource] = Field(
        max_length=64, description="publishers that `inputs` refers to by index"
    )
    steps: bytes = Field(max_length=4_000_000)
    inputs: bytes = Field(max_length=16_000_000)
    payloads: bytes = Field(default=b"", max_length=32_000_000)
    settings: str = Field(
        default="",
        max_length=1_000_000,
        description="JSON from which the service can be built again; with the first step only",
    )
    lost: int = Field(
        default=0,
        ge=0,
        description="messages applied since the service started that have no row in `inputs`",
    )
