"""Split a recording into runs of services, one per boot id, and list the inputs of each step.

A run is one process of a service (or one simulated one), from its first step to its last. Its
journal, see :mod:`common.journal.journal`, makes it replayable.
"""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from common.errors import SchemaError
from common.journal.tables import INPUT_COLUMNS, InputOutcome, Table, read_tables
from common.runtime.replay.numbers import Numbers
from common.schemas import Header, InputSource, StepJournal
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
    """At the recorder, on a clock that never goes back [ns]."""


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


Stream = tuple[str, str, int]
"""Names the messages of one topic from one run: topic, source, boot id."""


@dataclass
class Sent:
    """Messages of one topic from one run that are in a recording.

    Attributes:
        seqs: their numbers.
        last: the highest of these.
        began_ns: ``header.captured`` of the first [ns], as a rule the time of the step.
    """

    began_ns: int = 0
    last: int = -1
    seqs: Numbers = field(default_factory=Numbers)

    def add(self, header: Header) -> None:
        """Add a message."""
        if self.last < 0:
            self.began_ns = header.captured
        self.last = max(self.last, header.seq)
        self.seqs.add(header.seq)


@dataclass
class ServiceRun:
    """One run of a service, as far as it was recorded.

    Its steps are not kept: a :class:`StepReader` takes them out of the recording again.

    Attributes:
        service: its name.
        boot: its boot id.
        number: counts the runs of this service in the recording from 1.
        begin_ns: arrival of its first message at the recorder [ns].
        settings: JSON to build the service from; empty if not recorded.
        obstacle: why it cannot be replayed at all; empty if it can.
        ends: why it cannot be replayed beyond its last step here; empty if that was all.
        sent: messages of it in the recording, by topic name.
        needed: numbers of the messages that its steps take from the recording itself.
        span_ns: time of the first and of the last journaled step [ns].
    """

    service: str
    boot: int
    number: int
    begin_ns: int = 0
    settings: str = ""
    obstacle: str = ""
    ends: str = ""
    sent: dict[str, Sent] = field(default_factory=dict)
    needed: defaultdict[Stream, Numbers] = field(default_factory=lambda: defaultdict(Numbers))
    span_ns: tuple[int, int] = (0, 0)
    _steps: int = 0

    @property
    def length(self) -> int:
        """Number of steps that can be replayed."""
        return 0 if self.obstacle else self._steps

    def add(self, journal: StepJournal) -> None:
        """Append a journal message, if nothing is missing before it."""
        if self.ends or self.obstacle:
            return
        try:
            steps, inputs = read_tables(journal)
        except SchemaError as error:
            self.ends = str(error)
            return
        expected = self._steps
        if not len(steps) or journal.first_step + len(steps) <= expected:
            return
        if not expected and journal.first_step:
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
        begun = int(steps[0, 0]) if not expected else self.span_ns[0]
        self.span_ns = begun, int(steps[-1, 0])
        self._steps = journal.first_step + len(steps)
        lacking = (inputs[:, _OUTCOME] == InputOutcome.APPLIED) & (inputs[:, _SIZE] == 0)
        for index, seq in inputs[lacking][:, (_SOURCE, _SEQ)].tolist():
            self.needed[_stream(journal.sources[index])].add(seq)


class StepReader:
    """Takes the steps of a run out of its journals, as they come in the recording again."""

    def __init__(self, run: ServiceRun) -> None:
        """Start before the first journal."""
        self._run = run
        self._read = 0

    @property
    def at_end(self) -> bool:
        """Whether all steps that can be replayed have been read."""
        return self._read >= self._run.length

    def steps(self, message: Recorded) -> Iterator[Step]:
        """Yield the steps in a journal message that follow on those before."""
        if self.at_end:
            return
        journal = decode(message.payload, StepJournal, message.tag or None)
        steps, inputs = read_tables(journal)
        if journal.first_step == self._read:
            self._read += len(steps)
            yield from _walk(journal, steps, inputs)


def _stream(source: InputSource) -> Stream:
    return source.topic, source.source, source.boot


def _walk(journal: StepJournal, steps: Table, inputs: Table) -> Iterator[Step]:
    """Yield the steps of a journal message in order."""
    bounds = np.searchsorted(inputs[:, 0], np.arange(len(steps) + 1)).tolist()
    ends = np.cumsum(inputs[:, _SIZE]).tolist()
    rows = inputs.tolist()
    for index, (now, used) in enumerate(steps.tolist()):
        records = tuple(
            _input(journal, rows[number], ends[number])
            for number in range(bounds[index], bounds[index + 1])
            if rows[number][_OUTCOME] == InputOutcome.APPLIED
        )
        yield Step(journal.first_step + index, now, used != 0 or now == 0, records)


def _input(journal: StepJournal, row: list[int], end: int) -> InputRecord:
    source, injected, size = journal.sources[row[_SOURCE]], row[_INJECTED], row[_SIZE]
    return InputRecord(
        (*_stream(source), row[_SEQ]),
        row[_ARRIVAL] + injected,
        injected,
        source.schema_tag,
        journal.payloads[end - size : end] if size else None,
    )


def find_runs(messages: Iterable[Recorded]) -> list[ServiceRun]:
    """Find the runs whose journals are in a recording, in the order of their first ones.

    A run whose journal cannot be read by this version (see :mod:`common.wire.compatibility`) is
    listed with that as its obstacle.
    """
    runs: dict[tuple[str, int], ServiceRun] = {}
    sent: dict[tuple[str, int], dict[str, Sent]] = {}
    begun: dict[tuple[str, int], int] = {}
    for message in messages:
        header = wire_header(message.payload)
        if header is None:
            continue
        name = (header.source, header.boot)
        topics = sent.get(name)
        if topics is None:
            topics, begun[name] = sent.setdefault(name, {}), message.arrival_ns
        account = topics.get(message.topic.name)
        if account is None:
            account = topics[message.topic.name] = Sent()
        account.add(header)
        if message.topic is not JOURNAL:
            continue
        run = runs.get(name)
        if run is None:
            number = 1 + sum(service == header.source for service, _ in runs)
            run = ServiceRun(header.source, header.boot, number, begun[name], sent=topics)
            runs[name] = run
        try:
            run.add(decode(message.payload, StepJournal, message.tag or None))
        except SchemaError as error:
            run.obstacle = run.obstacle or f"its journal was written by another version: {error}"
    return list(runs.values())
