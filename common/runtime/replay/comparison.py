"""Compare the outputs of a replayed service with the recorded ones, message by message.

An output is encoded with the recorded header's transport fields (boot, sent, encode) and compared
to the byte; number, stamp, capture time and everything else are the replay's own.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

from common.errors import TrillError
from common.runtime.replay.difference import (
    FieldDifference,
    differences,
    is_of_other_version,
    stamped,
)
from common.runtime.replay.result import Difference, Report
from common.runtime.replay.runs import Recorded, Sent, ServiceRun, Step
from common.runtime.service import Output
from common.schemas import Header, Message
from common.topics import Topic

Listener = Callable[[Topic[Any], bytes, int], None]
"""Called with each replayed message: its topic, bytes and the time of its step [ns]."""


@dataclass(frozen=True)
class _Replayed:
    """An output that waits for its recorded counterpart."""

    step: Step
    topic: Topic[Any]
    seq: int
    message: Message


class OutputComparison:
    """Pairs replayed outputs with recorded messages and counts how they compare."""

    def __init__(
        self,
        run: ServiceRun,
        writes: Iterable[Topic[Any]],
        report: Report,
        *,
        tolerance: float,
        window_ns: tuple[int, int],
        on_message: Listener | None,
    ) -> None:
        """Start without a message.

        Args:
            run: the recorded run.
            writes: topics of the service.
            report: where counts and differences go.
            tolerance: as for :class:`~common.runtime.replay.runner.ReplayRunner`.
            window_ns: the same.
            on_message: the same.
        """
        self._run = run
        self._report = report
        self._tolerance, self._window = tolerance, window_ns
        self._on_message = on_message
        self._writes = {topic.name for topic in writes}
        self._recorded: dict[tuple[str, int], tuple[Recorded, Header]] = {}
        self._waiting: dict[tuple[str, int], _Replayed] = {}
        self._made: defaultdict[str, set[int]] = defaultdict(set)
        self._queried: dict[str, dict[int, int]] = {}

    @property
    def is_waiting(self) -> bool:
        """Whether outputs wait for their recorded counterparts."""
        return bool(self._waiting)

    def wanted(self, topic: Topic[Any], now_ns: int) -> bool:
        """Return the recorded answer: a service that asks publishes if and only if it is wanted."""
        times = self._queried.get(topic.name)
        if times is None:
            sent = self._run.sent.get(topic.name, Sent())
            times = dict(zip(sent.captured, sent.seqs, strict=True))
            self._queried[topic.name] = times
        return now_ns in times

    def add_recorded(self, message: Recorded, header: Header) -> None:
        """Add a message of the recording, of whatever topic and source."""
        own = header.boot == self._run.boot and header.source == self._run.service
        if own and message.topic.name in self._writes:
            self._recorded[message.topic.name, header.seq] = (message, header)

    def add_replayed(self, step: Step, output: Output) -> None:
        """Add an output and number it as a publisher would.

        Raises:
            TrillError: its topic is not among the service's ``writes``.
        """
        name = output.topic.name
        if name not in self._writes:
            raise TrillError(
                f"{self._run.service} published {name!r}; expected one of its `writes`: "
                f"{', '.join(sorted(self._writes)) or 'none'}"
            )
        seq = self._queried.get(name, {}).get(step.now_ns, len(self._made[name]))
        self._made[name].add(seq)
        self._waiting[name, seq] = _Replayed(step, output.topic, seq, output.message)

    def compare(self) -> None:
        """Compare the messages of which both counterparts are there."""
        for key in [key for key in self._waiting if key in self._recorded]:
            self._compare(self._waiting.pop(key), *self._recorded.pop(key))

    def finish(self, last: Step | None) -> None:
        """Count the messages that have no counterpart, after the ``last`` step replayed."""
        sent = self._run.sent
        began = min((s.captured[0] for name, s in sent.items() if name in self._writes), default=0)
        for made in self._waiting.values():
            if self._on_message is not None:
                payload = stamped(made.message, self._header(made, made.step.now_ns, 0))
                self._on_message(made.topic, payload, made.step.now_ns)
            known = sent.get(made.topic.name, Sent()).seqs
            lost = made.step.now_ns < began or (len(known) > 0 and made.seq < max(known))
            counts = self._report.outputs[made.topic.name]
            if lost:
                counts.unrecorded += 1
            elif made.step.now_ns >= self._window[0]:
                counts.extra += 1
                self._note(made, "extra")
        if last is not None:
            self._count_missing(last)

    def _count_missing(self, last: Step) -> None:
        """Count recorded outputs of the replayed steps that the replay does not have."""
        missing: list[tuple[int, str, int]] = []
        for name in self._writes & self._run.sent.keys():
            sent, made = self._run.sent[name], self._made[name]
            for seq, captured in zip(sent.seqs, sent.captured, strict=True):
                if seq not in made and self._window[0] <= captured <= last.now_ns:
                    self._report.outputs[name].missing += 1
                    missing.append((captured, name, seq))
        if missing:
            captured, name, seq = min(missing)
            steps = (step.number for step in self._run.steps() if step.now_ns >= captured)
            self._report.note(Difference(next(steps, last.number), captured, name, seq, "missing"))

    def _compare(self, made: _Replayed, recorded: Recorded, then: Header) -> None:
        header = self._header(made, then.sent, then.encode)
        if self._on_message is not None:
            self._on_message(made.topic, stamped(made.message, header), made.step.now_ns)
        if made.step.now_ns < self._window[0]:
            return
        report, counts = self._report, self._report.outputs[made.topic.name]
        found = differences(recorded, made.message, header)
        for item in found:
            name = f"{made.topic.name} {item.field.partition('[')[0]}"
            report.worst[name] = max(report.worst.get(name, 0.0), item.relative)
        if not found and is_of_other_version(recorded):
            counts.close += 1
        elif not found:
            counts.equal += 1
        elif self._tolerance > 0.0 and all(item.relative <= self._tolerance for item in found):
            counts.close += 1
        else:
            counts.differing += 1
            self._note(made, "differs", tuple(found))

    def _header(self, made: _Replayed, sent: int, encode: int) -> dict[str, Any]:
        own = made.message.header
        return {
            "seq": made.seq,
            "stamp": own.stamp,
            "captured": own.captured or made.step.now_ns,
            "sent": sent,
            "encode": encode,
            "boot": self._run.boot,
            "source": self._run.service,
            "injected": 0,
        }

    def _note(self, made: _Replayed, what: str, fields: tuple[FieldDifference, ...] = ()) -> None:
        where = (made.step.number, made.step.now_ns, made.topic.name, made.seq)
        self._report.note(Difference(*where, what, fields))
