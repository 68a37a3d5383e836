"""What each service says about its own health, twice a second."""

from pydantic import BaseModel, ConfigDict, Field

from common.schemas.base import Message


class LinkHealth(BaseModel):
    """One input of a service as that service sees it."""

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    topic: str
    received: int = Field(ge=0, description="messages that arrived, good or bad")
    rate: float = Field(ge=0.0, description="arrivals per second over the last second")
    age: float = Field(ge=-1.0, description="since the last good message [s]; -1: none yet")
    gaps: int = Field(ge=0, description="messages missing by sequence number")
    refused: int = Field(ge=0, description="not decodable or not valid")
    last_refusal: str = Field(default="", max_length=400)


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
