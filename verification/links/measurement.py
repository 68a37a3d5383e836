"""Delays that consumers saw, from the ledger of their journals, beside those requested."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from typing import Any

from common.errors import TrillError
from common.journal.ledger import Durations, Ledger
from common.links.predict import predict
from common.links.spec import LinkSpec
from common.links.summary import DelaySummary, requested, summarize
from verification.links.parts import RATE, Consumer


@dataclass(frozen=True)
class Measurement:
    """The messages that one consumer received over one link.

    Attributes:
        where: ``live`` or ``simulated``.
        consumer: how the consumer reads.
        link: specification of the link.
        injected: delay that the line injects, keeping order included [s].
        late: how much later than that the step has the message [s].
    """

    where: str
    consumer: str
    link: str
    injected: Durations
    late: Durations

    @property
    def achieved(self) -> Durations:
        """Time from the arrival at the consumer's transport to the step that has the message."""
        return self.injected + self.late

    @property
    def summaries(self) -> dict[str, DelaySummary]:
        """Distributions by name: requested, predicted, injected, achieved, late."""
        return {
            "requested": requested(LinkSpec.parse(self.link)),
            "predicted": _predicted(self.link),
            "injected": summarize(self.injected),
            "achieved": summarize(self.achieved),
            "late": summarize(self.late),
        }

    def as_json(self) -> dict[str, Any]:
        """Return all figures; durations in seconds."""
        figures = {name: summary._asdict() for name, summary in self.summaries.items()}
        about = {"where": self.where, "consumer": self.consumer, "link": self.link}
        return about | {"messages": len(self.late)} | figures


def measurements(
    where: str, link: str, consumers: Mapping[str, Consumer], ledger: Ledger
) -> list[Measurement]:
    """Take the measurements of ``consumers`` (by label) out of a ledger.

    Raises:
        TrillError: a consumer received no message.
    """
    samples = {row.consumer: row.samples for row in ledger.rows() if row.applied}
    missing = [consumer.name for consumer in consumers.values() if consumer.name not in samples]
    if missing:
        raise TrillError(f"no message came over the link {link} to {', '.join(missing)}")
    return [
        Measurement(where, label, link, mine["injected"], mine["queue"])
        for label, consumer in consumers.items()
        for mine in (samples[consumer.name],)
    ]


@cache
def _predicted(link: str) -> DelaySummary:
    return predict(LinkSpec.parse(link), RATE).predicted
