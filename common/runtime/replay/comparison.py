"""Compare the outputs of a replayed service with the recorded ones, message by message.

An output is encoded with the recorded header's transport fields (boot, sent, encode) and compared
to the byte; number, stamp, capture time and everything else are the replay's own.

The recording is read as the replay goes on, and only what waits for its counterpart is kept.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from heapq import heappop, heappush
from typing import Any

from common.errors import TrillError
from common.runtime.replay.difference import (
    FieldDifference,
    differences,
    is_of_other_version,
    stamped,
)
from common.runtime.replay.numbers import Numbers
from common.runtime.replay.result import Difference, Report
from common.runtime.replay.runs import Recorded, Sent, ServiceRun, Step
from common.runtime.service import Output
from common.schemas import Header, Message
from common.topics import Topic

_LATE_NS = 1_000_000_000
"""A message is recorded before any of the same run that was captured so much later [ns]."""

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
        read_on: Callable[[], bool],
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
            read_on: has :meth:`add_recorded` called with further messages of the recording; False
                at its end.
            tolerance: as for :class:`~common.runtime.replay.runner.ReplayRunner`.
            window_ns: the same.
            on_message: the same.
        """
        self._run = run
        self._report = report
        self._read_on = read_on
        self._tolerance, self._window = tolerance, window_ns
        self._on_message = on_message
        self._writes = {topic.name for topic in writes}
        own = [sent for name, sent in run.sent.items() if name in self._writes]
        self._began = min((sent.began_ns for sent in own), default=0)
        self._recorded: dict[tuple[str, int], tuple[Recorded, Header]] = {}
        self._waiting: dict[tuple[str, int], _Replayed] = {}
        self._made: defaultdict[str, Numbers] = defaultdict(Numbers)
        self._queried: set[str] = set()
        self._captured: defaultdict[str, dict[int, int]] = defaultdict(dict)
        """Numbers of the recorded messages that wait, by the time of their step [ns]."""
        self._passing: list[tuple[int, str, int]] = []
        """Heap of the recorded messages whose step is still to come: its time, topic, number."""
        self._passed: dict[tuple[str, int], int] = {}
        """Step of each recorded message that waits although its step is over."""
        self._read_to = -1
        """Latest time of a step of which a message has been read [ns]."""
        self._highest: dict[str, int] = {}
        """Highest number read, by topic."""
        self._extra: Difference | None = None

    @property
    def is_waiting(self) -> bool:
        """Whether outputs wait for their recorded counterparts."""
        return bool(self._waiting)

    def wanted(self, topic: Topic[Any], now_ns: int) -> bool:
        """Return the recorded answer: a service that asks publishes if and only if it is wanted."""
        name = topic.name
        self._queried.add(name)
        while (
            now_ns not in self._captured[name]
            and not self._is_read(name, now_ns)
            and self._read_on()
        ):
            pass
        return now_ns in self._captured[name]

    def _is_read(self, name: str, now_ns: int) -> bool:
        """Return whether no more messages of a topic from steps until ``now_ns`` are to come."""
        sent = self._run.sent.get(name)
        done = sent is None or self._highest.get(name, -1) >= sent.last
        return done or self._read_to > now_ns + _LATE_NS

    def add_recorded(self, message: Recorded, header: Header) -> None:
        """Add a message of the recording, of whatever topic and source."""
        if header.boot != self._run.boot or header.source != self._run.service:
            return
        self._read_to = max(self._read_to, header.captured)
        name, seq = message.topic.name, header.seq
        if name not in self._writes:
            return
        self._highest[name] = max(seq, self._highest.get(name, -1))
        if seq in self._made[name] and (name, seq) not in self._waiting:
            return  # It came twice.
        if (name, seq) not in self._recorded:
            heappush(self._passing, (header.captured, name, seq))
        self._recorded[name, seq] = (message, header)
        self._captured[name][header.captured] = seq

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
        seq = len(self._made[name])
        if name in self._queried:
            seq = self._captured[name].get(step.now_ns, seq)
        self._made[name].add(seq)
        made = _Replayed(step, output.topic, seq, output.message)
        if seq in self._run.sent.get(name, Sent()).seqs:
            self._waiting[name, seq] = made
        else:
            self._count_unrecorded(made)

    def compare(self) -> None:
        """Compare the messages of which both counterparts are there."""
        for key in [key for key in self._waiting if key in self._recorded]:
            message, header = self._recorded.pop(key)
            self._captured[key[0]].pop(header.captured, None)
            self._passed.pop(key, None)
            self._compare(self._waiting.pop(key), message, header)

    def end_step(self, step: Step) -> None:
        """Compare what ``step`` made, and note what it should have made too."""
        self.compare()
        while self._passing and self._passing[0][0] <= step.now_ns:
            _, name, seq = heappop(self._passing)
            if (name, seq) in self._recorded:
                self._passed[name, seq] = step.number

    def finish(self, last: Step | None) -> None:
        """Count the messages that have no counterpart, after the ``last`` step replayed."""
        if last is not None:
            while self._may_lack(last.now_ns) and self._read_on():
                pass
        if self._extra is not None:
            self._report.note(self._extra)
        if last is not None:
            self._count_missing(last)

    def _may_lack(self, now_ns: int) -> bool:
        """Return whether messages from steps until ``now_ns`` may be still to come."""
        return not all(self._is_read(name, now_ns) for name in self._writes)

    def _count_unrecorded(self, made: _Replayed) -> None:
        """Count an output that the recording does not have: lost there, or too much here."""
        now, name = made.step.now_ns, made.topic.name
        if self._on_message is not None:
            payload = stamped(made.message, self._header(made, now, 0))
            self._on_message(made.topic, payload, now)
        counts = self._report.outputs[name]
        if now < self._began or made.seq < self._run.sent.get(name, Sent()).last:
            counts.unrecorded += 1
        elif now >= self._window[0]:
            counts.extra += 1
            self._extra = self._extra or self._difference(made, "extra")

    def _count_missing(self, last: Step) -> None:
        """Count recorded outputs of the replayed steps that the replay does not have."""
        missing: list[tuple[int, str, int]] = []
        for (name, seq), (_, header) in self._recorded.items():
            if seq not in self._made[name] and self._window[0] <= header.captured <= last.now_ns:
                self._report.outputs[name].missing += 1
                missing.append((header.captured, name, seq))
        if missing:
            captured, name, seq = min(missing)
            step = self._passed.get((name, seq), last.number)
            self._report.note(Difference(step, captured, name, seq, "missing"))

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
            self._report.note(self._difference(made, "differs", tuple(found)))

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

    def _difference(
        self, made: _Replayed, what: str, fields: tuple[FieldDifference, ...] = ()
    ) -> Difference:
        where = (made.step.number, made.step.now_ns, made.topic.name, made.seq)
        return Difference(*where, what, fields)
