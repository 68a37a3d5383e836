"""The lives of services in a recording, and what every step of them took in.

A life is one process's (or one simulated service's) from its first step to its last; its messages
carry the same boot id. Its journal, see :mod:`common.journal.journal`, makes it replayable.
"""

from array import array
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np

from common.errors import SchemaError
from common.journal.journal import Table, Take, read_tables
from common.schemas import StepJournal, Stream
from common.topics import JOURNAL, Topic
from common.wire.codec import decode
from common.wire.header import wire_header

Key = tuple[str, str, int, int]
"""Names a message: topic, source, boot id, sequence number."""


class Recorded(NamedTuple):
    """A message in a recording, in its wire bytes."""

    topic: Topic[Any]
    payload: bytes
    tag: str
    """Schema tag given by the sender; empty if none."""
    arrival_ns: int
    """At the recorder [ns]."""


class Taken(NamedTuple):
    """A good message that a step took in."""

    key: Key
    arrival_ns: int
    """When the service could see it, injected delay included [ns]."""
    injected_ns: int
    payload: bytes | None
    """Its bytes if the journal has them."""


class Step(NamedTuple):
    """One step of a life."""

    number: int
    now_ns: int
    completed: bool
    """False for a step that raised, or whose end was not recorded."""
    taken: tuple[Taken, ...]


@dataclass(frozen=True)
class _Stretch:
    """The steps of one journal message."""

    first_step: int
    steps: Table
    takes: Table
    streams: list[Stream]
    payloads: bytes

    def walk(self) -> Iterator[Step]:
        """The steps, in order."""
        bounds = np.searchsorted(self.takes[:, 0], np.arange(len(self.steps) + 1)).tolist()
        ends = np.cumsum(self.takes[:, 11]).tolist()
        rows = self.takes.tolist()
        for index, (now, used) in enumerate(self.steps.tolist()):
            span = range(bounds[index], bounds[index + 1])
            applied = (number for number in span if rows[number][2] == Take.APPLIED)
            taken = tuple(self._taken(rows[number], ends[number]) for number in applied)
            yield Step(self.first_step + index, now, used != 0 or now == 0, taken)

    def _taken(self, row: list[int], end: int) -> Taken:
        stream, seq, arrival, injected, size = row[1], row[3], row[7], row[8], row[11]
        source = self.streams[stream]
        return Taken(
            (source.topic, source.source, source.boot, seq),
            arrival + injected,
            injected,
            self.payloads[end - size : end] if size else None,
        )


@dataclass
class Sent:
    """What a recording has of one topic from one life: numbers and times, in order of arrival."""

    seqs: "array[int]" = field(default_factory=lambda: array("q"))
    captured: "array[int]" = field(default_factory=lambda: array("q"))
    """``header.captured`` [ns], as a rule the time of the step."""


@dataclass
class ServiceRun:
    """One life of a service, as far as it was recorded.

    Attributes:
        service: its name.
        boot: its boot id.
        number: counts the lives of this service in the recording from 1.
        settings: JSON to build the service from; empty if not told.
        obstacle: why it cannot be replayed at all; empty if it can.
        ends: why it cannot be replayed beyond its last step here; empty if that was all.
        sent: what the recording has of it, by topic name.
    """

    service: str
    boot: int
    number: int
    settings: str = ""
    obstacle: str = ""
    ends: str = ""
    sent: dict[str, Sent] = field(default_factory=dict)
    _stretches: list[_Stretch] = field(default_factory=list)

    @property
    def length(self) -> int:
        """Steps that can be replayed."""
        last = self._stretches[-1] if self._stretches else None
        return 0 if last is None or self.obstacle else last.first_step + len(last.steps)

    @property
    def span_ns(self) -> tuple[int, int]:
        """Time of the first and of the last journaled step [ns]."""
        if not self._stretches:
            return 0, 0
        return int(self._stretches[0].steps[0, 0]), int(self._stretches[-1].steps[-1, 0])

    def steps(self) -> Iterator[Step]:
        """Every step that can be replayed, from the first."""
        if not self.obstacle:
            for stretch in self._stretches:
                yield from stretch.walk()

    def needed(self) -> set[Key]:
        """The messages that have to come from the recording itself."""
        return {taken.key for step in self.steps() for taken in step.taken if taken.payload is None}

    def add(self, journal: StepJournal) -> None:
        """Append a journal message, if nothing is missing before it."""
        if self.ends or self.obstacle:
            return
        try:
            steps, takes = read_tables(journal)
        except SchemaError as error:
            self.ends = str(error)
            return
        last = self._stretches[-1] if self._stretches else None
        expected = last.first_step + len(last.steps) if last else 0
        if not len(steps) or journal.first_step + len(steps) <= expected:
            return
        if last is None and journal.first_step:
            self.obstacle = (
                f"recording began at step {journal.first_step} of {self.service}, in the middle of "
                "its life; a replay needs it from step 0: record from before the service starts, "
                "or from a few seconds after"
            )
        elif journal.first_step != expected:
            self.ends = (
                f"the journal has no steps {expected} to {journal.first_step - 1}: the recording "
                "lost them"
            )
            return
        if journal.lost:
            # Which steps lack them is not known: at worst the first of this stretch.
            self.ends = f"from step {journal.first_step} on the journal lacks messages taken in"
            return
        self.settings = self.settings or journal.settings
        stretch = (journal.first_step, steps, takes, journal.streams, journal.payloads)
        self._stretches.append(_Stretch(*stretch))


def find_runs(messages: Iterable[Recorded]) -> list[ServiceRun]:
    """The lives whose journals are in a recording, in the order in which these begin.

    A life whose journal does not fit today's schema is listed with that as its obstacle.
    """
    lives: dict[tuple[str, int], ServiceRun] = {}
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
        life = lives.get(name)
        if life is None:
            number = 1 + sum(service == header.source for service, _ in lives)
            life = lives[name] = ServiceRun(header.source, header.boot, number, sent=sent[name])
        try:
            life.add(decode(message.payload, StepJournal, message.tag or None))
        except SchemaError as error:
            life.obstacle = life.obstacle or f"its journal was written by another version: {error}"
    return list(lives.values())
