"""Run one service again on its recorded inputs, and compare its outputs with the recorded ones.

The third way to run a service, beside :mod:`common.runtime.live.runner` and
:mod:`common.runtime.simulated.runner`. Each step gets the recorded time and exactly the messages
that the journal says it took in, with the recorded times of arrival and injected delays.

A service is the same in a replay provided that it looks at nothing but its inputs: no clock, no
unseeded random numbers, no file that has changed.
"""

import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator

from common.errors import SchemaError, TrillError
from common.inbox.inbox import Inbox
from common.runtime.replay.comparison import Listener, OutputComparison
from common.runtime.replay.result import Report
from common.runtime.replay.runs import (
    InputRecord,
    Key,
    Recorded,
    ServiceRun,
    Step,
    StepReader,
)
from common.runtime.service import Service
from common.schemas import Message
from common.topics import JOURNAL
from common.wire.decoder import Decoders
from common.wire.header import wire_header

Progress = Callable[[int, int], None]
"""Called now and then with the steps done and the steps to do."""

_STEPS_PER_PROGRESS = 50


class ReplayRunner:
    """Replays one run of one service, once.

    Attributes:
        report: the result, complete when :meth:`run` returns.
    """

    def __init__(
        self,
        service: Service,
        recorded: ServiceRun,
        messages: Iterable[Recorded],
        *,
        tolerance: float = 0.0,
        window_ns: tuple[int, int] = (0, 2**63),
        on_progress: Progress = lambda _done, _all: None,
        on_message: Listener | None = None,
    ) -> None:
        """Prepare; nothing is read yet.

        Args:
            service: a new one, built as the recorded one was.
            recorded: the run to replay.
            messages: the recording it is from, once through, in the order of arrival.
            tolerance: a number may differ by this much, relative to the field's largest magnitude
                (or to 1 if that is less); 0: not a bit.
            window_ns: steps whose outputs are compared, on the service's clock [ns]; all before
                are replayed, those after are not.
            on_progress: called now and then during :meth:`run`.
            on_message: called with each message that the service returns.

        Raises:
            TrillError: the run cannot be replayed, or ``service`` is another one.
        """
        if recorded.obstacle:
            raise TrillError(
                f"{recorded.service}, run {recorded.number}, cannot be replayed: "
                f"{recorded.obstacle}"
            )
        if service.name != recorded.service:
            raise TrillError(f"expected a service named {recorded.service!r}, got {service.name!r}")
        self.report = Report(recorded.service, recorded.number, recorded.boot)
        self._service, self._recorded = service, recorded
        service.boot = recorded.boot
        self._messages: Iterator[Recorded] = iter(messages)
        self._end_ns = window_ns[1]
        self._on_progress = on_progress
        self._inbox = Inbox(service.reads, service=service.name)
        self._inputs: dict[Key, Recorded] = {}
        self._decoders = Decoders()
        self._steps: deque[Step] = deque()
        self._journals = StepReader(recorded)
        self._comparison = OutputComparison(
            recorded,
            service.writes,
            self.report,
            self._advance,
            tolerance=tolerance,
            window_ns=window_ns,
            on_message=on_message,
        )
        self._now = 0
        service.wanted = lambda topic: self._comparison.wanted(topic, self._now)

    def run(self) -> Report:
        """Replay and compare; closes the service."""
        began = time.perf_counter()
        last: Step | None = None
        try:
            for step in self._read_steps():
                if step.now_ns > self._end_ns:
                    break
                if not self._replay(step):
                    break
                last = step
                if self._service.exit_code is not None:
                    self._note_early_end(step)
                    break
                if step.number % _STEPS_PER_PROGRESS == 0:
                    self._on_progress(step.number, self._recorded.length)
            else:
                self.report.stopped = self._recorded.ends
            # The recorded counterparts of the last outputs may still be to come.
            while self._comparison.is_waiting and self._advance():
                self._comparison.compare()
            self._comparison.finish(last)
        finally:
            self._service.close()
        report, (start, _) = self.report, self._recorded.span_ns
        report.wall = time.perf_counter() - began
        report.replayed = 1e-9 * (last.now_ns - start) if last else 0.0
        self._on_progress(self._recorded.length, self._recorded.length)
        return report

    def _read_steps(self) -> Iterator[Step]:
        """Yield every step that can be replayed, from the first; read on for more of them."""
        while True:
            while self._steps:
                yield self._steps.popleft()
            if self._journals.at_end or not self._advance():
                return

    def _note_early_end(self, step: Step) -> None:
        if step.number + 1 < self._recorded.length:
            self.report.stopped = (
                f"the service ended itself in step {step.number}, which it did not in the recording"
            )

    def _replay(self, step: Step) -> bool:
        """Run one step; False if it cannot be run or did not end."""
        inputs = []
        for item in step.inputs:
            message = self._input(item, step)
            if message is None:
                return False
            inputs.append((item.key[0], message, item.arrival_ns))
        self._now = step.now_ns
        self._inbox.begin_replayed_step(step.now_ns, inputs)
        report = self.report
        report.inputs += len(inputs)
        try:
            outputs = self._service.step(self._inbox, step.now_ns)
            self._service.after_step()
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
            self._comparison.add_replayed(step, output)
        self._comparison.end_step(step)
        return True

    def _input(self, item: InputRecord, step: Step) -> Message | None:
        """Return a message that the step took in; None, with the reason noted, if it is lost."""
        topic_name, source, _, seq = item.key
        payload, tag = item.payload, item.tag
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
                f"step {step.number} took in {topic_name}, which this version of "
                f"{self._service.name} does not read"
            )
            return None
        schema: type[Message] = topic.schema
        try:
            return self._decoders.decode(topic_name, payload, schema, tag or None, item.injected_ns)
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
        key = (message.topic.name, header.source, header.boot, header.seq)
        if header.seq in self._recorded.needed.get(key[:3], ()):
            self._inputs[key] = message
        self._comparison.add_recorded(message, header)
        own = header.boot == self._recorded.boot and header.source == self._recorded.service
        if own and message.topic is JOURNAL:
            self._steps.extend(self._journals.steps(message))
        return True
