"""Replay of incomplete recordings: every gap is reported, none is taken for a difference."""

from collections.abc import Sequence

import numpy as np
import pytest

from common.errors import TrillError
from common.journal.journal import Journal
from common.journal.tables import InputOutcome, InputTimes
from common.runtime.replay.runner import ReplayRunner
from common.runtime.replay.runs import Recorded, ServiceRun, find_runs
from common.runtime.service import Inputs, Output
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import Header
from common.topics import CAMERA_LEFT, JOURNAL, PLANT_STATE, WBC_COMMAND
from common.wire.codec import encode
from tests.common.runtime.replaying import (
    LINKS,
    jittery,
    lacking,
    recorded,
    replay,
    run_of,
    steps_of,
    without_payloads,
)
from tests.common.runtime.toys import (
    FilmingPlant,
    ToyController,
    ToyPlant,
    gait_request,
)


@pytest.fixture(scope="module")
def messages() -> list[Recorded]:
    return recorded(jittery())


def test_what_the_recorder_lost_is_no_difference(messages: list[Recorded]) -> None:
    report = replay(ToyController(), lacking(messages, WBC_COMMAND, lambda seq: 20 <= seq < 30))
    assert report.identical
    assert report.outputs["wbc/command"].unrecorded == 10
    late = replay(ToyController(), lacking(messages, WBC_COMMAND, lambda seq: seq < 50))
    assert late.identical
    assert late.outputs["wbc/command"].unrecorded == 50


def test_what_came_before_the_recorder_listened_is_no_difference() -> None:
    class Greeting(FilmingPlant):
        """Films once, at the very beginning."""

        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            outputs = super().step(inputs, now_ns)
            return [o for o in outputs if o.topic is not CAMERA_LEFT or self.steps == 10]

    runner = SimTimeRunner([Greeting()], record=True)
    runner.run_for(0.4)
    messages = recorded(runner)
    early = lacking(
        lacking(messages, CAMERA_LEFT, lambda _seq: True), PLANT_STATE, lambda seq: seq < 20
    )
    report = replay(Greeting(), early)
    assert report.identical
    assert report.outputs["camera/left"].unrecorded == 1
    # Had the recorder listened, it would be one.
    report = replay(Greeting(), lacking(messages, CAMERA_LEFT, lambda _seq: True))
    assert report.outputs["camera/left"].extra == 1
    assert not report.identical


def test_an_input_that_is_not_there_is_named(messages: list[Recorded]) -> None:
    whole = without_payloads(messages)
    taken = [
        item.key[3]
        for step in steps_of(whole, "wbc")
        for item in step.inputs
        if item.key[0] == "plant/state"
    ]
    victim = taken[100]
    report = replay(ToyController(), lacking(whole, PLANT_STATE, lambda seq: seq == victim))
    assert not report.identical
    assert f"took in plant/state number {victim} from sim, which is not in" in report.stopped
    assert report.first is None
    assert 0 < report.compared < 150


def test_a_recording_that_began_later_is_refused(messages: list[Recorded]) -> None:
    later = lacking(messages, JOURNAL, lambda seq: seq < 3)
    run = run_of(later, "wbc")
    assert run.length == 0
    with pytest.raises(TrillError, match="recording began at step 51 of wbc, in the middle"):
        ReplayRunner(ToyController(), run, later)


def test_a_hole_in_the_journal_ends_the_replay(messages: list[Recorded]) -> None:
    holed = lacking(messages, JOURNAL, lambda seq: seq == 3)
    report = replay(ToyController(), holed)
    assert report.steps == 51
    assert "no steps 51 to" in report.stopped
    assert report.first is None
    assert not report.identical


def test_what_a_journal_could_not_note_ends_the_replay() -> None:
    journal = Journal("wbc")
    journal.begin_step(0)
    for number in range(70):
        header = gait_request(number).header.model_copy(update={"source": f"s{number}"})
        journal.record("teleop/gait", InputOutcome.APPLIED, header, b"", "", InputTimes(0, 0, 0, 0))
    message = journal.fetch()
    assert message is not None
    assert message.lost == 6
    run = ServiceRun("wbc", 1, 1)
    run.add(message)
    assert run.length == 0
    assert "lacks messages taken in" in run.ends


def test_a_second_life_is_replayed_by_itself() -> None:
    runner = SimTimeRunner([ToyPlant(), ToyController()], seed=5, links=LINKS, record=True)
    runner.run_for(1.0)
    runner.replace_service("wbc", ToyController())
    runner.run_for(1.0)
    messages = recorded(runner)
    assert len([run for run in find_runs(messages) if run.service == "wbc"]) == 2
    first, second = (replay(ToyController(), messages, number) for number in (1, 2))
    assert first.identical
    assert second.identical
    assert first.boot != second.boot
    assert second.compared > 50


def test_a_failure_is_replayed_too() -> None:
    class Fragile(ToyController):
        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            if now_ns == 500_000_000:
                raise ValueError("broken on purpose")
            return super().step(inputs, now_ns)

    messages = recorded(jittery())
    report = replay(Fragile(), messages)
    assert "step 50, which it did not in the recording: ValueError: broken" in report.stopped
    assert not report.identical

    journal = Journal("wbc")
    message = None
    for step in range(51):
        journal.begin_step(step * 10_000_000)
        if step < 50:
            journal.end_step(step * 10_000_000 + 1)
    message = journal.fetch()
    assert message is not None
    run = ServiceRun("wbc", 1, 1)
    run.add(message)
    payload = encode(message, Header(source="wbc", boot=1))
    report = ReplayRunner(Fragile(), run, [Recorded(JOURNAL, payload, "", 0)]).run()
    assert report.stopped == ""
    assert "ValueError: broken on purpose" in report.failure


def test_what_nobody_wanted_is_not_asked_of_a_replay() -> None:
    class Shy(FilmingPlant):
        """Films only while somebody looks."""

        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            outputs = super().step(inputs, now_ns)
            return [o for o in outputs if o.topic is not CAMERA_LEFT or self.wanted(CAMERA_LEFT)]

    plant = Shy()
    runner = SimTimeRunner([plant], record=True)
    runner.run_for(0.3)
    plant.wanted = lambda _topic: False
    runner.run_for(0.3)
    plant.wanted = lambda _topic: True
    runner.run_for(0.4)
    report = replay(Shy(), recorded(runner))
    assert report.identical
    filmed = report.outputs["camera/left"]
    assert 0 < filmed.equal < 80
    assert filmed.extra == filmed.missing == filmed.unrecorded == 0


def test_an_array_off_by_nan_and_a_zeros_sign_are_found(messages: list[Recorded]) -> None:
    class Odd(ToyController):
        def __init__(self, value: float) -> None:
            super().__init__()
            self.value = value

        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            outputs = super().step(inputs, now_ns)
            return [
                Output(o.topic, o.message.model_copy(update={"torque": np.full(27, self.value)}))
                for o in outputs
            ]

    wrong = replay(Odd(np.nan), messages, tolerance=1.0)
    assert wrong.first is not None
    assert wrong.first.fields[0].delta == np.inf
    sign = replay(Odd(-0.0), messages)
    assert sign.first is not None
    assert sign.first.fields[0].field == "(bytes)"
    assert replay(Odd(-0.0), messages, tolerance=1e-15).identical


def test_another_service_is_refused(messages: list[Recorded]) -> None:
    with pytest.raises(TrillError, match="expected a service named 'wbc', got 'sim'"):
        ReplayRunner(ToyPlant(), run_of(messages, "wbc"), messages)


def test_a_service_has_no_settings_unless_it_says_so() -> None:
    assert ToyPlant().settings == {}
    with pytest.raises(TrillError, match="ToyPlant cannot be replayed"):
        ToyPlant.from_settings({})
