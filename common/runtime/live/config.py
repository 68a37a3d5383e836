"""Configure how a live service is run."""

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field, field_validator

from common.runtime.live.realtime import DEFAULT_PRIORITY
from common.topics import ALL_TOPICS


class RuntimeConfig(BaseModel):
    """How a live service is run."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    rt_priority: int = Field(
        default=DEFAULT_PRIORITY, ge=0, le=99, description="SCHED_FIFO priority; 0: normal"
    )
    spin_us: int = Field(
        default=100, ge=0, le=2000, description="last part of a wait, spent busy-waiting"
    )
    seed: int = Field(default=0, ge=0, description="of links without their own")
    max_age: dict[str, Annotated[float, Field(gt=0.0)]] = Field(
        default_factory=dict,
        description="by topic, instead of the table's: largest age on arrival that is applied, and "
        "silence after which the topic is stale and the hands hold [s]",
    )

    @field_validator("max_age")
    @classmethod
    def _known(cls, ages: dict[str, float]) -> dict[str, float]:
        known = {topic.name for topic in ALL_TOPICS}
        for name in ages.keys() - known:
            raise ValueError(f"no topic {name!r}; expected one of {', '.join(sorted(known))}")
        return ages
