"""Measure links in simulated time."""

from common.journal.ledger import Ledger
from common.runtime.simulated.runner import SimTimeRunner
from common.topics import JOURNAL
from verification.links.measurement import Measurement, measurements
from verification.links.parts import LINKS, Sender, simulated_consumers

SETTLE_S = 20.0
"""Longer than nearly every delay: by then messages leave the link as often as they come [s]."""


def measure(link: str, seconds: float, seed: int = 0) -> list[Measurement]:
    """Set ``link`` on every input at a virtual time and measure for ``seconds`` of it."""
    consumers = simulated_consumers()
    runner = SimTimeRunner([Sender(), *consumers.values()], seed=seed, journal=True)
    runner.run_for(1.0)
    for name in LINKS:
        runner.set_link(name, link)
    runner.run_for(SETTLE_S)
    begin = runner.now_ns
    end = begin + round(1e9 * seconds)
    ledger = Ledger()
    runner.on_message(JOURNAL, lambda journal: ledger.add(journal, begin, end))
    runner.run_for(seconds + 1.0)
    return measurements("simulated", link, consumers, ledger)
