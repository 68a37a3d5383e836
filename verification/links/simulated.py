"""The links in simulated time."""

from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import StepJournal
from common.topics import JOURNAL
from verification.links.parts import Sender, simulated_consumers
from verification.links.records import Result, Takes, result

SETTLE_S = 1.0
DRAIN_S = 20.0
"""Longer than nearly any delay [s]."""


def measure(link: str, seconds: float, seed: int = 0) -> list[tuple[Result, Takes]]:
    """Set ``link`` on every input at a virtual time and measure for ``seconds`` of it."""
    parts = simulated_consumers()
    runner = SimTimeRunner([Sender(), *parts.values()], seed=seed, journal=True)
    seen = {part.name: Takes() for part in parts.values()}

    def note(message: StepJournal) -> None:
        if message.service in seen:
            seen[message.service].add(message)

    runner.on_message(JOURNAL, note)
    runner.run_for(SETTLE_S)
    start = runner.now_ns
    for name in ("teleop/setpoint", "camera/left"):
        runner.set_link(name, link)
    runner.run_for(seconds)
    end = runner.now_ns
    runner.run_for(DRAIN_S)
    found = []
    for label, part in parts.items():
        takes = seen[part.name].between(start, end)
        found.append((result("simulated", label, link, takes), takes))
    return found
