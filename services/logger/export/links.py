"""One input of a service as plain numbers, which every viewer can plot."""

from pydantic import BaseModel, ConfigDict

from common.schemas import LinkHealth


class LinkPlot(BaseModel):
    """A link's health with its stages laid flat; times in seconds, -1 where nothing is known."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    age: float
    rate: float
    received: int
    gaps: int
    late: int
    skipped: int
    stale: int
    refused: int
    lost: int
    injected_requested_mean: float
    injected_requested_p99: float
    injected_achieved_mean: float
    injected_achieved_p99: float
    capture_median: float = -1.0
    capture_p99: float = -1.0
    encode_median: float = -1.0
    encode_p99: float = -1.0
    wire_median: float = -1.0
    wire_p99: float = -1.0
    injected_median: float = -1.0
    injected_p99: float = -1.0
    queue_median: float = -1.0
    queue_p99: float = -1.0
    decode_median: float = -1.0
    decode_p99: float = -1.0
    use_median: float = -1.0
    use_p99: float = -1.0
    total_median: float = -1.0
    total_p99: float = -1.0
    link: str = ""

    @classmethod
    def of(cls, link: LinkHealth) -> "LinkPlot":
        """The numbers of ``link``."""
        stages = {f"{one.stage}_median": one.median for one in link.stages}
        stages |= {f"{one.stage}_p99": one.p99 for one in link.stages}
        return cls(
            age=link.age,
            rate=link.rate,
            received=link.received,
            gaps=link.gaps,
            late=link.late,
            skipped=link.skipped,
            stale=link.stale,
            refused=link.refused,
            lost=link.lost,
            injected_requested_mean=link.requested_mean,
            injected_requested_p99=link.requested_p99,
            injected_achieved_mean=link.achieved_mean,
            injected_achieved_p99=link.achieved_p99,
            link=link.link,
            **stages,
        )
