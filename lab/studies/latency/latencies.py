"""Measures the age of the messages that a service acted on, from its journal."""

from collections import defaultdict

import numpy as np

from common.journal.tables import (
    INPUT_COLUMNS,
    STEP_COLUMNS,
    UNKNOWN,
    InputOutcome,
    read_tables,
)
from common.schemas import StepJournal

_NOW = STEP_COLUMNS.index("now")
_COLUMN = {name: number for number, name in enumerate(INPUT_COLUMNS)}

Input = tuple[str, str]
"""Consumer and topic."""


class Latencies:
    """Latency of each input: from sending a message to the step of the consumer that acted on it.

    If one step takes in several messages, it acts on the newest. Messages from a sender whose clock
    offset is unknown are left out.
    """

    def __init__(self) -> None:
        self._found: defaultdict[Input, list[float]] = defaultdict(list)
        self._lost: defaultdict[Input, int] = defaultdict(int)

    def add(self, journal: StepJournal) -> None:
        """Add the steps of a journal.

        Raises:
            SchemaError: the journal contradicts itself.
        """
        steps, inputs = read_tables(journal)
        for index, source in enumerate(journal.sources):
            at = (journal.service, source.topic)
            mine = inputs[inputs[:, _COLUMN["source"]] == index]
            outcomes = mine[:, _COLUMN["outcome"]]
            self._lost[at] += int((outcomes == InputOutcome.LOST).sum())
            known = mine[:, _COLUMN["offset"]] != UNKNOWN
            used = mine[(outcomes == InputOutcome.APPLIED) & known]
            sent_at = used[:, _COLUMN["sent"]] + used[:, _COLUMN["offset"]]
            newest: dict[int, int] = {}
            for step, sent in zip(used[:, 0].tolist(), sent_at.tolist(), strict=True):
                newest[step] = max(sent, newest.get(step, sent))
            self._found[at] += [
                1e-9 * (int(steps[step, _NOW]) - sent) for step, sent in newest.items()
            ]

    def of(self, consumer: str, topic: str) -> list[float]:
        """Return the latencies of one input in order of time [s]."""
        return list(self._found.get((consumer, topic), ()))

    def lost(self, consumer: str, topic: str) -> int:
        """Return the number of messages that the input's link lost on purpose."""
        return self._lost.get((consumer, topic), 0)


def mean_p99(latencies: list[float]) -> tuple[float, float] | None:
    """Return mean and 99th percentile; None: there are no latencies."""
    if not latencies:
        return None
    return float(np.mean(latencies)), float(np.percentile(latencies, 99))
