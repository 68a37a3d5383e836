"""What a service took in is kept in small pieces until somebody listens, and not for ever."""

from typing import Any

import numpy as np
import pytest

from common.inbox.inbox import Inbox
from common.journal.journal import PERIOD_NS, Journal
from common.journal.tables import InputOutcome, InputTimes, read_tables
from common.runtime.live import journal_publisher as journaling
from common.runtime.live.components import RunnerContext
from common.runtime.live.journal_publisher import JournalPublisher
from common.schemas import Header, Message, StepJournal
from common.topics import JOURNAL, Topic

STEP_NS = 10_000_000


class Bench:
    """A journaling component of a service at 100 Hz."""

    def __init__(self) -> None:
        self.journal = Journal("wbc", {"rate": 100})
        self.component = JournalPublisher(self.journal)
        self.wanted = False
        self.sent: list[tuple[int, StepJournal]] = []
        self.now = self.steps = 0
        context: Any = RunnerContext(
            None, "r", "wbc", 1, Inbox(()), self._send, lambda _: self.wanted
        )
        self.component.open(context)

    def _send(self, topic: Topic[Any], message: Message) -> None:
        assert topic is JOURNAL
        assert isinstance(message, StepJournal)
        self.sent.append((self.now, message))

    def run(self, seconds: float) -> None:
        for _ in range(round(seconds * 1e9) // STEP_NS):
            self.now += STEP_NS
            self.journal.begin_step(self.now)
            header = Header(seq=self.steps, source="sim", boot=7)
            times = InputTimes(self.now, 0, 0, 0)
            self.journal.record("plant/state", InputOutcome.APPLIED, header, bytes(100), "", times)
            self.journal.end_step(self.now)
            self.steps += 1
            self.component.poll(self.now)

    def steps_sent(self) -> list[int]:
        """Numbers of the steps sent, in the order in which they were."""
        return [
            message.first_step + index
            for _, message in self.sent
            for index in range(len(read_tables(message)[0]))
        ]


def test_a_late_listener_gets_a_life_from_its_first_step_in_small_pieces() -> None:
    bench = Bench()
    bench.run(50.0)
    assert bench.sent == []
    bench.wanted = True
    bench.run(15.0)
    bench.component.close()
    assert bench.steps_sent() == list(range(bench.steps))
    assert bench.sent[0][1].settings
    payloads = [message.payloads for _, message in bench.sent]
    assert len(b"".join(payloads)) == pytest.approx(500 * 100, rel=0.02)
    at, counts = np.unique([at for at, _ in bench.sent], return_counts=True)
    assert counts[:-1].max() <= 8
    assert max(len(message.steps) for _, message in bench.sent) <= 16 * 26
    # The backlog is caught up with; then it is one message a period again.
    assert counts[-5:-1].tolist() == [1] * 4
    assert np.diff(at[-5:-1]).min() >= PERIOD_NS


@pytest.mark.parametrize(("bound", "most"), [("_MAX_WAITING_BYTES", 100_000), ("_MAX_WAITING", 50)])
def test_too_much_is_given_up_from_the_oldest(
    monkeypatch: pytest.MonkeyPatch, bound: str, most: int
) -> None:
    monkeypatch.setattr(journaling, bound, most)
    bench = Bench()
    bench.run(60.0)
    bench.wanted = True
    bench.component.close()
    numbers = bench.steps_sent()
    assert numbers == list(range(numbers[0], bench.steps))
    assert numbers[0] > 0
    sizes = [len(m.steps) + len(m.inputs) + len(m.payloads) for _, m in bench.sent]
    kept = sum(sizes) if bound == "_MAX_WAITING_BYTES" else len(sizes)
    assert 0.9 * most < kept <= most


def test_takes_that_nobody_hears_are_given_up_before_they_count_as_lost() -> None:
    bench = Bench()
    header = Header(source="sim", boot=7)
    for step in range(1000):
        bench.now += STEP_NS
        bench.journal.begin_step(bench.now)
        for _ in range(300):
            bench.journal.record(
                "teleop/gait", InputOutcome.APPLIED, header, b"", "", InputTimes(bench.now, 0, 0, 0)
            )
        bench.journal.end_step(bench.now)
        bench.component.poll(bench.now)
        bench.steps = step + 1
    bench.wanted = True
    bench.component.close()
    numbers = bench.steps_sent()
    assert numbers == list(range(numbers[0], 1000))
    assert numbers[0] > 0
    for _, message in bench.sent:
        steps, inputs = read_tables(message)
        assert (message.lost, len(inputs)) == (0, 300 * len(steps))
