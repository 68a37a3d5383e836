"""A recorded run of toys, and ways to spoil it before it is replayed."""

from collections.abc import Callable, Sequence
from typing import Any

from common.journal.tables import read_tables
from common.runtime.replay.result import Report
from common.runtime.replay.runner import ReplayRunner
from common.runtime.replay.runs import Recorded, ServiceRun, Step, StepReader, find_runs
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import Header, StepJournal
from common.topics import JOURNAL, PLANT_STATE, TELEOP_GAIT, WBC_COMMAND
from common.transport.keys import topic_of
from common.wire.codec import decode, encode
from common.wire.header import wire_header
from tests.common.runtime.toys import (
    ToyController,
    ToyPlant,
    gait_request,
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
    """The same recording with journals that carry no message, as after a run's first seconds."""
    return [
        changed(message, _strip) if message.topic is JOURNAL else message for message in messages
    ]


def _strip(journal: StepJournal) -> StepJournal:
    inputs = read_tables(journal)[1].copy()
    inputs[:, 11] = 0
    return journal.model_copy(update={"inputs": inputs.tobytes(), "payloads": b""})


def changed(message: Recorded, change: Callable[[Any], Any]) -> Recorded:
    before = decode(message.payload, message.topic.schema)
    return message._replace(payload=encode(change(before), before.header))


def run_of(messages: Sequence[Recorded], service: str, number: int = 1) -> ServiceRun:
    return next(
        run for run in find_runs(messages) if (run.service, run.number) == (service, number)
    )


def steps_of(messages: Sequence[Recorded], service: str) -> list[Step]:
    run = run_of(messages, service)
    reader = StepReader(run)
    journals = [
        message
        for message in messages
        if message.topic is JOURNAL and sender_of(message) == (run.service, run.boot)
    ]
    return [step for message in journals for step in reader.steps(message)]


def sender_of(message: Recorded) -> tuple[str, int]:
    header = wire_header(message.payload)
    assert header is not None
    return header.sender


def replay(service: Service, messages: Sequence[Recorded], number: int = 1, **how: Any) -> Report:
    return ReplayRunner(service, run_of(messages, service.name, number), messages, **how).run()


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
