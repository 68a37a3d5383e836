"""Replay: the same inputs at the same steps, every difference found."""

from collections.abc import Sequence

import pytest

from common.journal.tables import InputOutcome, read_tables
from common.runtime.replay.runs import Recorded, ServiceRun, find_runs
from common.runtime.service import Inputs, Output
from common.schemas import StepJournal
from common.topics import JOURNAL, WBC_COMMAND
from common.wire.codec import decode
from common.wire.header import wire_header
from tests.common.runtime.replaying import (
    Off,
    Spy,
    jittery,
    lacking,
    recorded,
    replay,
    without_payloads,
)
from tests.common.runtime.toys import (
    ToyController,
    ToyPlant,
    joint_command,
)


@pytest.fixture(scope="module")
def messages() -> list[Recorded]:
    return recorded(jittery())


@pytest.mark.parametrize("strip", [False, True])
def test_everything_is_identical_to_the_byte(messages: list[Recorded], strip: bool) -> None:
    messages = without_payloads(messages) if strip else messages
    for service in (ToyPlant(), ToyController()):
        report = replay(service, messages)
        assert report.identical, report
        (tally,) = report.outputs.values()
        assert tally.equal == tally.compared > 150
        assert report.inputs > 150


@pytest.mark.parametrize("strip", [False, True])
def test_the_inbox_answers_as_it_did(strip: bool) -> None:
    original = Spy()
    messages = recorded(jittery(original))
    outcomes = {outcome for run in find_runs(messages) for outcome in outcomes_of(messages, run)}
    assert {
        InputOutcome.APPLIED,
        InputOutcome.LATE,
        InputOutcome.STALE,
        InputOutcome.LOST,
    } <= outcomes
    again = Spy()
    replay(again, without_payloads(messages) if strip else messages)
    length = len(again.answers)
    # The journal of the last quarter of a second is not out yet.
    assert length > 150
    assert again.answers == original.answers[:length]


def outcomes_of(messages: Sequence[Recorded], run: ServiceRun) -> set[InputOutcome]:
    found: set[InputOutcome] = set()
    for message in messages:
        header = wire_header(message.payload)
        if message.topic is JOURNAL and header is not None and header.boot == run.boot:
            inputs = read_tables(decode(message.payload, StepJournal))[1]
            found |= {InputOutcome(number) for number in inputs[:, 2].tolist()}
    return found


def test_the_first_difference_is_told(messages: list[Recorded]) -> None:
    report = replay(Off(40, 1e-12), messages)
    assert not report.identical
    assert report.first is not None
    assert (report.first.step, report.first.now_ns) == (40, 400_000_000)
    assert (report.first.topic, report.first.what) == ("wbc/command", "differs")
    (field,) = report.first.fields
    assert field.field == "position[4]"
    assert field.recorded != field.replayed
    assert field.delta == pytest.approx(1e-12, rel=1e-3)
    tally = report.outputs["wbc/command"]
    assert 0 < tally.equal < 40
    assert tally.differing == tally.compared - tally.equal > 100


def test_a_tolerance_accepts_no_more_than_it_says(messages: list[Recorded]) -> None:
    assert replay(Off(40, 1e-12), messages, tolerance=1e-11).identical
    assert not replay(Off(40, 1e-10), messages, tolerance=1e-11).identical


def test_only_the_window_is_compared(messages: list[Recorded]) -> None:
    before = replay(Off(40, 0.1), messages, window_ns=(0, 390_000_000))
    assert before.identical
    assert before.steps == 40
    after = replay(Off(40, 0.1), messages, window_ns=(1_000_000_000, 2**63))
    assert after.first is not None
    assert after.first.now_ns == 1_000_000_000
    assert after.outputs["wbc/command"].equal == 0
    assert after.outputs["wbc/command"].missing == 0


def test_missing_and_extra_outputs_are_differences(messages: list[Recorded]) -> None:
    class Silent(ToyController):
        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            outputs = super().step(inputs, now_ns)
            return outputs if now_ns < 1_000_000_000 else []

    report = replay(Silent(), messages)
    assert report.first is not None
    assert (report.first.what, report.first.step) == ("missing", 100)
    assert report.outputs["wbc/command"].missing > 50

    class Chatty(ToyController):
        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            outputs = list(super().step(inputs, now_ns))
            more = [Output(WBC_COMMAND, joint_command(0.0))] if now_ns == 1_500_000_000 else []
            return outputs + more

    report = replay(Chatty(), messages)
    assert report.first is not None
    # Its own number 150 meets the recorded one of the step after.
    assert (report.first.what, report.first.step) == ("differs", 150)
    assert "header.captured" in {field.field for field in report.first.fields}
    report = replay(ToyController(), lacking(messages, WBC_COMMAND, lambda seq: seq >= 150))
    assert report.first is not None
    assert report.first.what == "extra"
    assert report.outputs["wbc/command"].extra > 20
