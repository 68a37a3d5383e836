"""Measure links in simulated time."""

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import StepJournal
from common.topics import JOURNAL
from verification.links.parts import LINKS, Sender, simulated_consumers
from verification.links.records import Measurement, Records

SETTLE_S = 1.0
DRAIN_S = 20.0
"""Longer than nearly every delay [s]."""


def measure(link: str, seconds: float, seed: int = 0) -> list[Measurement]:
    """Set ``link`` on every input at a virtual time and measure for ``seconds`` of it."""
    consumers = simulated_consumers()
    runner = SimTimeRunner([Sender(), *consumers.values()], seed=seed, journal=True)
    records = {consumer.name: Records() for consumer in consumers.values()}

    def add(journal: StepJournal) -> None:
        if journal.service in records:
            records[journal.service].add(journal)

    runner.on_message(JOURNAL, add)
    runner.run_for(SETTLE_S)
    start = runner.now_ns
    for name in LINKS:
        runner.set_link(name, link)
    runner.run_for(seconds)
    end = runner.now_ns
    runner.run_for(DRAIN_S)
    return [
        Measurement("simulated", label, link, records[consumer.name].between(start, end))
        for label, consumer in consumers.items()
    ]
