"""Health of a service, published twice a second, and its heartbeat."""

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from common.schemas.base import Message


class _Part(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)


class StageTime(_Part):
    """Time that the messages of an input spent in one stage, over the last seconds.

    ``capture``: from capturing the information to encoding it. ``encode``: in the codec.
    ``wire``: from there to arriving at the reader's transport, by the estimated clock offset.
    ``injected``: held by the link's delay line. ``queue``: waiting for the reader's next step.
    ``decode``: in the codec. ``use``: from the start of that step to its results being sent.
    ``total``: all of it.
    """

    stage: Literal["capture", "encode", "wire", "injected", "queue", "decode", "use", "total"]
    median: float = Field(description="[s]")
    p99: float = Field(description="[s]")


class LinkHealth(_Part):
    """Health of one input of a service: message counts, rate, age, and the delay of its link.

    The service that reads the input measures it. Counts are since the start of that service.
    """

    topic: str
    received: int = Field(ge=0, description="messages that arrived, good or bad")
    rate: float = Field(ge=0.0, description="arrivals per second over the last second")
    age: float = Field(ge=-1.0, description="since the last good message [s]; -1: none yet")
    gaps: int = Field(ge=0, description="messages missing by sequence number")
    late: int = Field(default=0, ge=0, description="overtaken by a newer one")
    repeated: int = Field(default=0, ge=0, description="arrived again")
    skipped: int = Field(default=0, ge=0, description="dropped unread: the service stood still")
    stale: int = Field(default=0, ge=0, description="too old when they arrived, not applied")
    adapted: int = Field(
        default=0, ge=0, description="of another version of the schema, but readable"
    )
    foreign: int = Field(
        default=0, ge=0, description="from another sender than the one followed, not applied"
    )
    refused: int = Field(ge=0, description="not decodable or not valid")
    last_refusal: str = Field(default="", max_length=400)
    link: str = Field(default="", max_length=200, description="what is injected; empty: nothing")
    requested_mean: float = Field(default=0.0, ge=0.0, description="of the injected delay [s]")
    requested_p99: float = Field(default=0.0, ge=0.0, description="[s]")
    achieved_mean: float = Field(default=0.0, ge=0.0, description="since the link was set [s]")
    achieved_p99: float = Field(default=0.0, ge=0.0, description="[s]")
    lost: int = Field(default=0, ge=0, description="dropped by the link on purpose")
    stages: list[StageTime] = Field(default_factory=list, max_length=8)


class OutputHealth(_Part):
    """Health of one output of a service."""

    topic: str
    sent: int = Field(ge=0, description="messages handed to the transport")
    errors: int = Field(ge=0, description="messages the transport refused")


class PeerHealth(_Part):
    """Health of another service, as measured by the service that reports it."""

    source: str
    alive: bool = Field(description="its heartbeat arrives")
    silent: float = Field(ge=-1.0, description="since its last heartbeat [s]; -1: none yet")
    losses: int = Field(default=0, ge=0, description="times its heartbeat stopped")
    clock_offset: float = Field(default=0.0, description="its clock is behind this one's by [s]")
    clock_error: float = Field(default=-1.0, ge=-1.0, description="at most [s]; -1: not known")


class ServiceHealth(Message):
    """A service's loop timing and the health of its inputs; published by its runner."""

    service: str
    pid: int
    period: float = Field(ge=0.0, description="nominal [s]")
    steps: int = Field(ge=0)
    deadline_misses: int = Field(ge=0, description="steps that ended after the next was due")
    step_median: float = Field(ge=0.0, description="over the last window [s]")
    step_p99: float = Field(ge=0.0, description="[s]")
    cpu: float = Field(ge=0.0, description="share of one core over the last window")
    realtime: str = Field(description="scheduling in force, e.g. 'SCHED_FIFO 20' or 'normal'")
    links: list[LinkHealth]
    outputs: list[OutputHealth] = Field(default_factory=list)
    peers: list[PeerHealth] = Field(default_factory=list)
    conflict: str = Field(
        default="", max_length=200, description="other processes in its place; empty: none"
    )


class Heartbeat(Message):
    """Heartbeat of a service, sent by its own loop so that it stops when the loop does."""

    steps: int = Field(ge=0, description="made by the loop so far")
    timeout: float = Field(
        gt=0.0, le=10.0, description="heartbeat timeout: silence after which it counts as lost [s]"
    )
    uptime: float = Field(default=0.0, ge=0.0, description="since it joined the bus [s]")
