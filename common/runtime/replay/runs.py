"""Split a recording into service runs, one per boot id, and list the inputs of each step.

A run is one process of a service (or one simulated one), from its first step to its last. Its
journal, see :mod:`common.journal.journal`, makes it replayable.
"""

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from common.errors import SchemaError
from common.journal.tables import INPUT_COLUMNS, InputOutcome, Table, read_tables
from common.schemas import InputSource, StepJournal
from common.topics import JOURNAL, Topic
from common.wire.codec import decode
from common.wire.header import wire_header

Key = tuple[str, str, int, int]
"""Names a message: topic, source, boot id, sequence number."""

_SOURCE, _OUTCOME, _SEQ, _ARRIVAL, _INJECTED, _SIZE = (
    INPUT_COLUMNS.index(name)
    for name in ("source", "outcome", "seq", "arrival", "injected", "size")
)


class Recorded(NamedTuple):
    """A message in a recording, in its wire bytes."""

    topic: Topic[Any]
    payload: bytes
    tag: str
    """Schema tag given by the sender; empty if none."""
    arrival_ns: int
    """At the recorder [ns]."""


class InputRecord(NamedTuple):
    """A message that a step took in and applied."""

    key: Key
    arrival_ns: int
    """When the service could see it, injected delay included [ns]."""
    injected_ns: int
    tag: str
    """Schema tag given by the sender."""
    payload: bytes | None
    """Its bytes if the journal has them."""


class Step(NamedTuple):
    """One step of a run."""

    number: int
    now_ns: int
    completed: bool
    """False for a step that raised, or whose end was not recorded."""
    inputs: tuple[InputRecord, ...]


@dataclass(frozen=True)
class _JournalChunk:
    """The steps of one journal message."""

    first_step: int
    steps: Table
    inputs: Table
    sources: list[InputSource]
    payloads: bytes

    def walk(self) -> Iterator[Step]:
        """Yield the steps in order."""
        bounds = np.searchsorted(self.inputs[:, 0], np.arange(len(self.steps) + 1)).tolist()
        ends = np.cumsum(self.inputs[:, _SIZE]).tolist()
        rows = self.inputs.tolist()
        for index, (now, used) in enumerate(self.steps.tolist()):
            inputs = tuple(
                self._input(rows[number], ends[number])
                for number in range(bounds[index], bounds[index + 1])
                if rows[number][_OUTCOME] == InputOutcome.APPLIED
            )
            yield Step(self.first_step + index, now, used != 0 or now == 0, inputs)

    def _input(self, row: list[int], end: int) -> InputRecord:
        source, injected, size = self.sources[row[_SOURCE]], row[_INJECTED], row[_SIZE]
        return InputRecord(
            (source.topic, source.source, source.boot, row[_SEQ]),
            row[_ARRIVAL] + injected,
            injected,
            source.schema_tag,
            self.payloads[end - size : end] if size else None,
        )


@dataclass
class Sent:
    """Messages of one topic from one run that are in a recording, in order of arrival."""

    seqs: "array[int]" = field(default_factory=lambda: array("q"))
    captured: "array[int]" = field(default_factory=lambda: array("q"))
    """``header.captured`` [ns], as a rule the time of the step."""


@dataclass
class ServiceRun:
    """One run of a service, as far as it was recorded.

    Attributes:
        service: its name.
        boot: its boot id.
        number: counts the runs of this service in the recording from 1.
        settings: JSON to build the service from; empty if not recorded.
        obstacle: why it cannot be replayed at all; empty if it can.
        ends: why it cannot be replayed beyond its last step here; empty if that was all.
        sent: messages of it in the recording, by topic name.
    """

    service: str
    boot: int
    number: int
    settings: str = ""
    obstacle: str = ""
    ends: str = ""
    sent: dict[str, Sent] = field(default_factory=dict)
    _chunks: list[_JournalChunk] = field(default_factory=list)

    @property
    def length(self) -> int:
        """Number of steps that can be replayed."""
        last = self._chunks[-1] if self._chunks else None
        return 0 if last is None or self.obstacle else last.first_step + len(last.steps)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Time of the first and of the last journaled step [ns]."""
        if not self._chunks:
            return 0, 0
        return int(self._chunks[0].steps[0, 0]), int(self._chunks[-1].steps[-1, 0])

    def steps(self) -> Iterator[Step]:
        """Yield every step that can be replayed, from the first."""
        if not self.obstacle:
            for chunk in self._chunks:
                yield from chunk.walk()

    def needed(self) -> set[Key]:
        """Return the keys of the messages that have to come from the recording itself."""
        return {item.key for step in self.steps() for item in step.inputs if item.payload is None}

    def add(self, journal: StepJournal) -> None:
        """Append a journal message, if nothing is missing before it."""
        if self.ends or self.obstacle:
            return
        try:
            steps, inputs = read_tables(journal)
        except SchemaError as error:
            self.ends = str(error)
            return
        last = self._chunks[-1] if self._chunks else None
        expected = last.first_step + len(last.steps) if last else 0
        if not len(steps) or journal.first_step + len(steps) <= expected:
            return
        if last is None and journal.first_step:
            self.obstacle = (
                f"recording began at step {journal.first_step} of {self.service}, in the middle of "
                "its run; a replay needs it from step 0: record from before the service starts, "
                "or from a few seconds after"
            )
        elif journal.first_step != expected:
            self.ends = (
                f"the journal has no steps {expected} to {journal.first_step - 1}: the recording "
                "lost them"
            )
            return
        if journal.lost:
            # Which steps lack them is not known: at worst the first of this chunk.
            self.ends = f"from step {journal.first_step} on the journal lacks messages taken in"
            return
        self.settings = self.settings or journal.settings
        chunk = (journal.first_step, steps, inputs, journal.sources, journal.payloads)
        self._chunks.append(_JournalChunk(*chunk))


def find_runs(messages: Iterable[Recorded]) -> list[ServiceRun]:
    """Find the service runs whose journals are in a recording, in the order of their first ones.

    A run whose journal cannot be read by this version (see :mod:`common.wire.compatibility`) is
    listed with that as its obstacle.
    """
    runs: dict[tuple[str, int], ServiceRun] = {}
    sent: dict[tuple[str, int], dict[str, Sent]] = {}
    for message in messages:
        header = wire_header(message.payload)
        if header is None:
            continue
        name = (header.source, header.boot)
        account = sent.setdefault(name, {}).setdefault(message.topic.name, Sent())
        account.seqs.append(header.seq)
        account.captured.append(header.captured)
        if message.topic is not JOURNAL:
            continue
        run = runs.get(name)
        if run is None:
            number = 1 + sum(service == header.source for service, _ in runs)
            run = runs[name] = ServiceRun(header.source, header.boot, number, sent=sent[name])
        try:
            run.add(decode(message.payload, StepJournal, message.tag or None))
        except SchemaError as error:
            run.obstacle = run.obstacle or f"its journal was written by another version: {error}"
    return list(runs.values())
