"""Replay: the same inputs at the same steps, every difference found, every lack told."""

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest

from common.bus.codec import decode, encode
from common.bus.journal import Journal, Take, read_tables
from common.bus.keys import topic_of
from common.bus.wire import wire_header
from common.errors import TrillError
from common.runtime.lives import Life, Recorded, find_lives
from common.runtime.replay import ReplayRunner
from common.runtime.replay_report import Report
from common.runtime.service import Inputs, Output, Service
from common.runtime.simtime import SimTimeRunner
from common.schemas import Header, StepJournal
from common.topics import CAMERA_LEFT, JOURNAL, PLANT_STATE, TELEOP_GAIT, WBC_COMMAND
from tests.runtime.toys import (
    FilmingPlant,
    ToyController,
    ToyPlant,
    gait_request,
    joint_command,
    plant_state,
)

LINKS = {
    "wbc:plant/state": "normal(30ms, 40ms) loss=5% order=free",
    "wbc:teleop/gait": "normal(20ms, 20ms) order=free",
    "wbc/command": "lognormal(12ms, 6ms)",
}


class Spy(ToyController):
    """Keeps all that its inbox ever answers."""

    def __init__(self) -> None:
        super().__init__()
        self.answers: list[object] = []

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        state = inputs.latest(PLANT_STATE)
        self.answers.append(
            (
                now_ns,
                None if state is None else (state.header, state.joint_position.tobytes()),
                inputs.updated(PLANT_STATE),
                inputs.fresh(PLANT_STATE),
                inputs.age(PLANT_STATE),
                [(event.header, event.request_id) for event in inputs.events(TELEOP_GAIT)],
                inputs.updated(TELEOP_GAIT),
                inputs.age(TELEOP_GAIT),
            )
        )
        return super().step(inputs, now_ns)


class Off(ToyController):
    """Commands a little more than it should from a certain step on."""

    def __init__(self, from_step: int, by: float) -> None:
        super().__init__()
        self.left, self.by = from_step, by

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        outputs = super().step(inputs, now_ns)
        self.left -= 1
        if self.left >= 0 or not outputs:
            return outputs
        message: Any = outputs[0].message
        position = message.position.copy()
        position[4] += self.by
        return [Output(WBC_COMMAND, message.model_copy(update={"position": position}))]


def recorded(runner: SimTimeRunner) -> list[Recorded]:
    found = []
    for sample in runner.log:
        topic = topic_of("draco3", sample.key)
        assert topic is not None
        found.append(Recorded(topic, sample.payload, sample.tag, sample.arrival_ns))
    return found


def too_old(number: int, now_ns: int) -> bytes:
    """A state that was under way for twice the time in which it is of use."""
    header = Header(seq=number, sent=now_ns - 200_000_000, boot=9, source="old")
    return encode(plant_state(9.0), header)


def jittery(controller: Service | None = None, seconds: float = 2.0) -> SimTimeRunner:
    """A run with delays, losses, garbage and events."""
    services = [ToyPlant(), controller or ToyController()]
    runner = SimTimeRunner(services, seed=5, links=LINKS, record=True)
    for number in range(round(seconds / 0.1)):
        runner.run_for(0.095)
        runner.inject(TELEOP_GAIT, gait_request(number))
        runner.inject(TELEOP_GAIT, gait_request(100 + number))
        runner.inbox("wbc").offer("plant/state", b"garbage", runner.now_ns)
        if number >= 3:
            runner.inbox("wbc").offer("plant/state", too_old(number, runner.now_ns), runner.now_ns)
        runner.run_for(0.005)
    return runner


def without_payloads(messages: Sequence[Recorded]) -> list[Recorded]:
    """The same recording with journals that carry no message, as after a life's first seconds."""
    return [
        changed(message, _strip) if message.topic is JOURNAL else message for message in messages
    ]


def _strip(journal: StepJournal) -> StepJournal:
    takes = read_tables(journal)[1].copy()
    takes[:, 11] = 0
    return journal.model_copy(update={"takes": takes.tobytes(), "payloads": b""})


def changed(message: Recorded, change: Callable[[Any], Any]) -> Recorded:
    before = decode(message.payload, message.topic.schema)
    return message._replace(payload=encode(change(before), before.header))


def life_of(messages: Sequence[Recorded], service: str, number: int = 1) -> Life:
    return next(
        life for life in find_lives(messages) if (life.service, life.number) == (service, number)
    )


def replay(service: Service, messages: Sequence[Recorded], number: int = 1, **how: Any) -> Report:
    return ReplayRunner(service, life_of(messages, service.name, number), messages, **how).run()


def lacking(
    messages: Sequence[Recorded], topic: object, gone: Callable[[int], bool]
) -> list[Recorded]:
    """The recording without those messages of a topic (of the controller, if it is the journal)."""
    kept = []
    for message in messages:
        header = wire_header(message.payload)
        assert header is not None
        mine = message.topic is topic and (topic is not JOURNAL or header.source == "wbc")
        if not (mine and gone(header.seq)):
            kept.append(message)
    return kept


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
    kinds = {kind for life in find_lives(messages) for kind in kinds_of(messages, life)}
    assert {Take.APPLIED, Take.LATE, Take.STALE, Take.LOST} <= kinds
    again = Spy()
    replay(again, without_payloads(messages) if strip else messages)
    length = len(again.answers)
    # The journal of the last quarter of a second is not out yet.
    assert length > 150
    assert again.answers == original.answers[:length]


def kinds_of(messages: Sequence[Recorded], life: Life) -> set[Take]:
    found: set[Take] = set()
    for message in messages:
        header = wire_header(message.payload)
        if message.topic is JOURNAL and header is not None and header.boot == life.boot:
            takes = read_tables(decode(message.payload, StepJournal))[1]
            found |= {Take(kind) for kind in takes[:, 2].tolist()}
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
        for step in life_of(whole, "wbc").steps()
        for item in step.taken
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
    life = life_of(later, "wbc")
    assert life.length == 0
    with pytest.raises(TrillError, match="recording began at step 51 of wbc, in the middle"):
        ReplayRunner(ToyController(), life, later)


def test_a_hole_in_the_journal_ends_the_replay(messages: list[Recorded]) -> None:
    holed = lacking(messages, JOURNAL, lambda seq: seq == 3)
    report = replay(ToyController(), holed)
    assert report.steps == 51
    assert "no steps 51 to" in report.stopped
    assert report.first is None
    assert not report.identical


def test_what_a_journal_could_not_note_ends_the_replay() -> None:
    journal = Journal("wbc")
    journal.begin(0)
    for number in range(70):
        header = gait_request(number).header.model_copy(update={"source": f"s{number}"})
        journal.take("teleop/gait", Take.APPLIED, header, b"", (0, 0, 0, 0))
    message = journal.fetch()
    assert message is not None
    assert message.lost == 6
    life = Life("wbc", 1, 1)
    life.add(message)
    assert life.length == 0
    assert "lacks messages taken in" in life.ends


def test_a_second_life_is_replayed_by_itself() -> None:
    runner = SimTimeRunner([ToyPlant(), ToyController()], seed=5, links=LINKS, record=True)
    runner.run_for(1.0)
    runner.replace_service("wbc", ToyController())
    runner.run_for(1.0)
    messages = recorded(runner)
    assert len([life for life in find_lives(messages) if life.service == "wbc"]) == 2
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
        journal.begin(step * 10_000_000)
        if step < 50:
            journal.end(step * 10_000_000 + 1)
    message = journal.fetch()
    assert message is not None
    life = Life("wbc", 1, 1)
    life.add(message)
    report = ReplayRunner(Fragile(), life, []).run()
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
        ReplayRunner(ToyPlant(), life_of(messages, "wbc"), messages)


def test_a_service_has_no_settings_unless_it_says_so() -> None:
    assert ToyPlant().settings == {}
    with pytest.raises(TrillError, match="ToyPlant cannot be replayed"):
        ToyPlant.from_settings({})
