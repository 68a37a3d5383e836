"""Runs one service again on what it was given when it was recorded, and compares what it says.

The third way to run a service, beside :mod:`common.runtime.live.runner` and
:mod:`common.runtime.simulated.runner`. Each step gets the recorded time and exactly the messages
that the journal says it took in, with the recorded times of arrival and injected delays. What the
service returns is encoded with the recorded header's transport fields (boot, sent, encode) and
compared to the byte; number, stamp, capture time and everything else are the replay's own.

A service is the same in a replay provided that it looks at nothing but its inputs: no clock, no
unseeded random numbers, no file that has changed.
"""

import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any

from common.errors import SchemaError, TrillError
from common.inbox.inbox import Inbox
from common.runtime.replay.difference import FieldDifference, differences, stamped
from common.runtime.replay.result import Difference, Report
from common.runtime.replay.runs import Key, Recorded, Sent, ServiceRun, Step, Taken
from common.runtime.service import Output, Service
from common.schemas import Header, Message
from common.topics import Topic
from common.wire.codec import decode
from common.wire.header import wire_header

Progress = Callable[[int, int], None]
"""Told the steps done and the steps to do, now and then."""
Listener = Callable[[Topic[Any], bytes, int], None]
"""Given each replayed message: its topic, bytes and the time of its step [ns]."""

_TELL_EVERY = 50


@dataclass(frozen=True)
class _Replayed:
    """An output that waits for its recorded counterpart."""

    step: Step
    topic: Topic[Any]
    seq: int
    message: Message


class ReplayRunner:
    """Replays one life of one service, once."""

    def __init__(
        self,
        service: Service,
        life: ServiceRun,
        messages: Iterable[Recorded],
        *,
        tolerance: float = 0.0,
        window_ns: tuple[int, int] = (0, 2**63),
        progress: Progress = lambda _done, _all: None,
        listener: Listener | None = None,
    ) -> None:
        """Prepare; nothing is read yet.

        Args:
            service: a new one, built as the recorded one was.
            life: which life of it.
            messages: the recording it is from, once through, in the order of arrival.
            tolerance: a number may differ by this much, relative to the field's largest magnitude
                (or to 1 if that is less); 0: not a bit.
            window_ns: steps whose outputs are compared, on the service's clock [ns]; all before
                are replayed, those after are not.
            progress: told how far it is.
            listener: given what the service says.

        Raises:
            TrillError: the life cannot be replayed, or ``service`` is another one.
        """
        if life.obstacle:
            raise TrillError(
                f"{life.service}, life {life.number}, cannot be replayed: {life.obstacle}"
            )
        if service.name != life.service:
            raise TrillError(f"expected a service named {life.service!r}, got {service.name!r}")
        self.report = Report(life.service, life.number, life.boot)
        self._service, self._life = service, life
        self._messages: Iterator[Recorded] = iter(messages)
        self._tolerance, self._window = tolerance, window_ns
        self._progress, self._listener = progress, listener
        self._inbox = Inbox(service.reads, service=service.name)
        self._needed = life.needed()
        self._inputs: dict[Key, Recorded] = {}
        self._recorded: dict[tuple[str, int], tuple[Recorded, Header]] = {}
        self._waiting: dict[tuple[str, int], _Replayed] = {}
        self._made: defaultdict[str, set[int]] = defaultdict(set)
        self._writes = {topic.name for topic in service.writes}
        self._asked: dict[str, dict[int, int]] = {}
        self._now = 0
        service.wanted = self._wanted

    def run(self) -> Report:
        """Replay and compare; closes the service."""
        began = time.perf_counter()
        last: Step | None = None
        try:
            for step in self._life.steps():
                if step.now_ns > self._window[1]:
                    break
                if not self._replay(step):
                    break
                last = step
                if self._service.exit_code is not None:
                    self._ended_itself(step)
                    break
                if step.number % _TELL_EVERY == 0:
                    self._progress(step.number, self._life.length)
            else:
                self.report.stopped = self._life.ends
            self._settle(last)
        finally:
            self._service.close()
        report, (start, _) = self.report, self._life.span_ns
        report.wall = time.perf_counter() - began
        report.replayed = 1e-9 * (last.now_ns - start) if last else 0.0
        self._progress(self._life.length, self._life.length)
        return report

    def _ended_itself(self, step: Step) -> None:
        if step.number + 1 < self._life.length:
            self.report.stopped = (
                f"the service ended itself in step {step.number}, which it did not in the recording"
            )

    def _replay(self, step: Step) -> bool:
        """Run one step; False if it cannot be run or did not end."""
        taken = []
        for item in step.taken:
            message = self._input(item, step)
            if message is None:
                return False
            taken.append((item.key[0], message, item.arrival_ns))
        self._now = step.now_ns
        self._inbox.begin_replayed_step(step.now_ns, taken)
        report = self.report
        report.inputs += len(taken)
        try:
            outputs = self._service.step(self._inbox, step.now_ns)
        except Exception as error:  # noqa: BLE001 - what it raised may be what was recorded
            report.failure = f"step {step.number}: {type(error).__name__}: {error}"
            if step.completed:
                report.stopped = (
                    f"the service failed in step {step.number}, which it did not in the recording: "
                    f"{type(error).__name__}: {error}"
                )
            return False
        report.steps += 1
        for output in outputs:
            self._emit(step, output)
        self._compare_waiting()
        return True

    def _input(self, item: Taken, step: Step) -> Message | None:
        """The message that the step took in; None (and why) if it cannot be had."""
        topic_name, source, _, seq = item.key
        payload, tag = item.payload, ""
        while payload is None:
            recorded = self._inputs.pop(item.key, None)
            if recorded is not None:
                payload, tag = recorded.payload, recorded.tag
            elif not self._advance():
                self.report.stopped = (
                    f"step {step.number} took in {topic_name} number {seq} from {source}, which is "
                    "not in the recording; nothing after it can be replayed faithfully"
                )
                return None
        topic = next((t for t in self._service.reads if t.name == topic_name), None)
        if topic is None:
            self.report.stopped = (
                f"step {step.number} took in {topic_name}, which this version of {source} does "
                "not read"
            )
            return None
        schema: type[Message] = topic.schema
        try:
            return decode(payload, schema, tag or None, item.injected_ns)
        except SchemaError as error:
            self.report.stopped = f"step {step.number} took in what cannot be read today: {error}"
            return None

    def _advance(self) -> bool:
        """Read one message more of the recording; False at its end."""
        message = next(self._messages, None)
        if message is None:
            return False
        header = wire_header(message.payload)
        if header is None:
            return True
        name = message.topic.name
        key = (name, header.source, header.boot, header.seq)
        if key in self._needed:
            self._inputs[key] = message
        mine = header.boot == self._life.boot and header.source == self._life.service
        if mine and name in self._writes:
            self._recorded[name, header.seq] = (message, header)
        return True

    def _wanted(self, topic: Topic[Any]) -> bool:
        """What the service was told then: where it asks, it published if it was wanted."""
        times = self._asked.get(topic.name)
        if times is None:
            sent = self._life.sent.get(topic.name, Sent())
            times = dict(zip(sent.captured, sent.seqs, strict=True))
            self._asked[topic.name] = times
        return self._now in times

    def _emit(self, step: Step, output: Output) -> None:
        """Give an output its number, as a publisher would."""
        name = output.topic.name
        if name not in self._writes:
            raise TrillError(
                f"{self._service.name} published {name!r}; expected one of its `writes`: "
                f"{', '.join(sorted(self._writes)) or 'none'}"
            )
        seq = self._asked.get(name, {}).get(self._now, len(self._made[name]))
        self._made[name].add(seq)
        self._waiting[name, seq] = _Replayed(step, output.topic, seq, output.message)

    def _compare_waiting(self) -> None:
        """Compare what is there in both."""
        for key in [key for key in self._waiting if key in self._recorded]:
            self._compare(self._waiting.pop(key), *self._recorded.pop(key))

    def _compare(self, made: _Replayed, recorded: Recorded, then: Header) -> None:
        header = self._header(made, then.sent, then.encode)
        if self._listener is not None:
            self._listener(made.topic, stamped(made.message, header), made.step.now_ns)
        if made.step.now_ns < self._window[0]:
            return
        report, tally = self.report, self.report.outputs[made.topic.name]
        found = differences(recorded, made.message, header)
        for item in found:
            name = f"{made.topic.name} {item.field.partition('[')[0]}"
            report.worst[name] = max(report.worst.get(name, 0.0), item.relative)
        if not found:
            tally.equal += 1
        elif self._tolerance > 0.0 and all(item.relative <= self._tolerance for item in found):
            tally.close += 1
        else:
            tally.differing += 1
            self._note(made, "differs", tuple(found))

    def _header(self, made: _Replayed, sent: int, encode: int) -> dict[str, Any]:
        own = made.message.header
        return {
            "seq": made.seq,
            "stamp": own.stamp,
            "captured": own.captured or made.step.now_ns,
            "sent": sent,
            "encode": encode,
            "boot": self._life.boot,
            "source": self._service.name,
            "injected": 0,
        }

    def _note(self, made: _Replayed, what: str, fields: tuple[FieldDifference, ...] = ()) -> None:
        where = (made.step.number, made.step.now_ns, made.topic.name, made.seq)
        self.report.note(Difference(*where, what, fields))

    def _settle(self, last: Step | None) -> None:
        """Find the recorded counterparts still to come, and account for what has none."""
        while self._waiting and self._advance():
            self._compare_waiting()
        sent = self._life.sent
        began = min((s.captured[0] for name, s in sent.items() if name in self._writes), default=0)
        for made in self._waiting.values():
            if self._listener is not None:
                payload = stamped(made.message, self._header(made, made.step.now_ns, 0))
                self._listener(made.topic, payload, made.step.now_ns)
            known = sent.get(made.topic.name, Sent()).seqs
            lost = made.step.now_ns < began or (len(known) > 0 and made.seq < max(known))
            tally = self.report.outputs[made.topic.name]
            if lost:
                tally.unrecorded += 1
            elif made.step.now_ns >= self._window[0]:
                tally.extra += 1
                self._note(made, "extra")
        if last is not None:
            self._settle_missing(last)

    def _settle_missing(self, last: Step) -> None:
        """Account for what was recorded of the steps replayed and not said again."""
        missing: list[tuple[int, str, int]] = []
        for name in self._writes & self._life.sent.keys():
            sent, made = self._life.sent[name], self._made[name]
            for seq, captured in zip(sent.seqs, sent.captured, strict=True):
                if seq not in made and self._window[0] <= captured <= last.now_ns:
                    self.report.outputs[name].missing += 1
                    missing.append((captured, name, seq))
        if missing:
            captured, name, seq = min(missing)
            steps = (step.number for step in self._life.steps() if step.now_ns >= captured)
            self.report.note(Difference(next(steps, last.number), captured, name, seq, "missing"))
