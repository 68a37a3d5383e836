"""Simulated time: exact, deterministic, and the same codec, inbox and links as live."""

from collections.abc import Sequence

import numpy as np
import pytest

from common.errors import ConfigError, SchemaError, TrillError
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import JointCommand, PlantState
from common.topics import PLANT_STATE, TELEOP_GAIT, WBC_COMMAND
from common.wire.codec import decode, schema_tag
from common.wire.decoder import Decoder
from tests.common.runtime.toys import ToyController, ToyPlant, gait_request, plant_state

MS = 1_000_000
LINKS = {
    "wbc:plant/state": "normal(8ms, 4ms) loss=5%",
    "wbc/command": "lognormal(12ms, 6ms) order=free",
}


def jittery_run(seed: int, seconds: float = 2.0) -> SimTimeRunner:
    runner = SimTimeRunner([ToyPlant(), ToyController()], seed=seed, links=LINKS, record=True)
    runner.run_for(seconds)
    return runner


def test_same_seed_same_bytes() -> None:
    first, second = jittery_run(5), jittery_run(5)
    assert len(first.log) > 500
    assert first.digest() == second.digest()
    assert first.log == second.log
    assert jittery_run(6).digest() != first.digest()


def test_in_pieces_or_at_once_is_the_same() -> None:
    pieces = jittery_run(5, 0.0)
    for _ in range(40):
        pieces.run_for(0.05)
    assert pieces.digest() == jittery_run(5).digest()


def test_clock_and_number_of_steps() -> None:
    plant, controller = ToyPlant(), ToyController()
    runner = SimTimeRunner([plant, controller])
    runner.run_for(0.25)
    assert runner.now_ns == 250 * MS
    assert plant.steps == 250
    runner.run_until(200 * MS)
    assert (runner.now_ns, plant.steps) == (250 * MS, 250)
    runner.run_until(250 * MS + 1)
    assert plant.steps == 251


def test_offsets_shift_a_service() -> None:
    plant, controller = ToyPlant(), ToyController()
    runner = SimTimeRunner([plant, controller], offsets_ns={"wbc": 3 * MS, "sim": 100})
    runner.run_for(0.05)
    assert plant.seen[0][1] == 13 * MS
    assert plant.seen[0][0] == 13 * MS + 100
    assert [now for now, *_ in controller.seen] == [13 * MS, 23 * MS, 33 * MS, 43 * MS]


def test_at_equal_times_the_order_of_the_list_decides() -> None:
    # The plant publishes in its steps at 4, 9, 14, ... ms.
    for services, first_seen in (
        ([ToyPlant(every=1), ToyController()], 0),
        ([ToyController(), ToyPlant(every=1)], 9 * MS),
    ):
        runner = SimTimeRunner(services)
        runner.run_for(0.03)
        controller = next(s for s in services if isinstance(s, ToyController))
        assert controller.seen[0][1] == first_seen


def test_transport_delay_is_exact_and_told() -> None:
    plant, controller = ToyPlant(every=1), ToyController()
    runner = SimTimeRunner([plant, controller], links={"plant/state": "5ms", "wbc/command": "7ms"})
    runner.run_for(0.2)
    for now, sent, injected in controller.seen:
        assert now - sent == 5 * MS == injected
    for now, sent, injected in plant.seen:
        assert now - sent == 7 * MS == injected
    assert len(plant.seen) > 15


def test_jitter_follows_the_seed() -> None:
    ages = []
    for seed in (1, 1, 2):
        controller = ToyController()
        runner = SimTimeRunner([ToyPlant(), controller], seed=seed, links=LINKS)
        runner.run_for(0.5)
        ages.append([injected for _, _, injected in controller.seen])
    assert ages[0] == ages[1] != ages[2]
    assert len(set(ages[0])) > 20


def test_delay_of_one_consumer_leaves_the_others_alone() -> None:
    class Listener(ToyController):
        """Sees, and says nothing."""

        name = "other"
        writes = ()

        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            super().step(inputs, now_ns)
            return []

    first, second = ToyController(), Listener()
    runner = SimTimeRunner([ToyPlant(every=1), first, second], links={"other:plant/state": "20ms"})
    runner.run_for(0.1)
    assert {now - sent for now, sent, _ in first.seen} == {0}
    assert {now - sent for now, sent, _ in second.seen} == {20 * MS}


def test_headers_are_stamped_by_the_runner() -> None:
    runner = jittery_run(5, 0.1)
    states = [s for s in runner.log if s.key == "draco3/plant/state"]
    messages = [decode(s.payload, PlantState, s.tag) for s in states]
    assert [m.header.seq for m in messages] == list(range(20))
    assert [m.header.sent for m in messages] == [s.arrival_ns for s in states]
    assert {(m.header.source, m.header.injected) for m in messages} == {("sim", 0)}
    boots = {m.header.boot for m in messages}
    assert len(boots) == 1
    other_log = jittery_run(6, 0.1).log
    other = next(decode(s.payload, PlantState) for s in other_log if s.key == "draco3/plant/state")
    assert [m.header.captured for m in messages] == [m.header.sent for m in messages]
    assert {m.header.encode for m in messages} == {0}
    assert other.header.boot not in boots
    # The service's own stamp is kept.
    assert messages[3].header.stamp == 19 * MS


def test_unread_messages_are_not_encoded_but_keep_their_numbers() -> None:
    class Spoiled(ToyPlant):
        """Publishes a message that cannot be encoded, as long as ``bad`` is set."""

        bad = True

        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            message = plant_state(0.0)
            if self.bad:
                message = message.model_copy(update={"reset_count": 2**80})
            return [Output(PLANT_STATE, message)]

    plant = Spoiled()
    runner = SimTimeRunner([plant])
    runner.run_for(0.01)
    plant.bad = False
    seen: list[PlantState] = []
    runner.on_message(PLANT_STATE, seen.append)
    runner.run_for(0.002)
    assert [message.header.seq for message in seen] == [10, 11]
    plant.bad = True
    with pytest.raises(SchemaError):
        runner.run_for(0.001)


def test_record_holds_unread_messages_too() -> None:
    runner = SimTimeRunner([ToyPlant()], record=True, journal=False, robot="r2")
    runner.run_for(0.01)
    assert [(s.key, s.arrival_ns, s.tag) for s in runner.log] == [
        ("r2/plant/state", 4 * MS, schema_tag(PlantState)),
        ("r2/plant/state", 9 * MS, schema_tag(PlantState)),
    ]


def test_taps_see_messages_as_published() -> None:
    runner = SimTimeRunner([ToyPlant(), ToyController()], links={"wbc/command": "50ms"})
    commands: list[JointCommand] = []
    runner.on_message(WBC_COMMAND, commands.append)
    runner.run_for(0.05)
    assert [c.header.sent for c in commands] == [10 * MS, 20 * MS, 30 * MS, 40 * MS]
    assert all(c.header.injected == 0 for c in commands)
    assert not commands[0].position.flags.writeable


def test_the_newest_message_is_decoded_only_when_it_is_asked_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    decoded: list[bytes] = []
    decode_once = Decoder.decode

    def counted(decoder: Decoder[PlantState], payload: bytes) -> PlantState:
        decoded.append(payload)
        return decode_once(decoder, payload)

    monkeypatch.setattr(Decoder, "decode", counted)
    runner = SimTimeRunner([ToyPlant()])
    newest = runner.newest(PLANT_STATE)
    assert newest() is None
    runner.run_for(0.05)
    assert decoded == []
    state = newest()
    assert state is not None
    assert state.header.stamp == 49 * MS
    assert len(decoded) == 1


def test_callbacks_share_a_message() -> None:
    runner = SimTimeRunner([ToyPlant()])
    first: list[PlantState] = []
    second: list[PlantState] = []
    runner.on_message(PLANT_STATE, first.append)
    runner.on_message(PLANT_STATE, second.append)
    runner.run_for(0.01)
    assert len(first) == 2
    assert all(a is b for a, b in zip(first, second, strict=True))


def test_injected_messages_arrive_like_any_other() -> None:
    controller = ToyController()
    runner = SimTimeRunner([controller], links={"teleop/gait": "15ms"})
    runner.inject(TELEOP_GAIT, gait_request(1))
    runner.run_for(0.01)
    runner.inject(TELEOP_GAIT, gait_request(2), source="policy")
    runner.run_for(0.01)
    assert [g.request_id for g in controller.gaits] == []
    runner.run_for(0.02)
    assert [(g.request_id, g.header.source, g.header.sent) for g in controller.gaits] == [
        (1, "inject", 0),
        (2, "policy", 10 * MS),
    ]


def test_paused_service_is_silent_and_comes_back_on_its_grid() -> None:
    plant, controller = ToyPlant(every=1), ToyController()
    runner = SimTimeRunner([plant, controller])
    runner.run_for(0.05)
    runner.pause_service("wbc")
    runner.run_for(0.105)
    assert [sent for _, sent, _ in plant.seen][-1] == 40 * MS
    steps = plant.steps
    assert steps == 155
    runner.resume_service("wbc")
    runner.run_for(0.02)
    # It read on from an inbox that kept the newest.
    assert [sent for _, sent, _ in controller.seen][-2:] == [160 * MS, 170 * MS]
    assert runner.inbox("wbc").health_of(PLANT_STATE).skipped > 0
    assert runner.inbox("wbc").health_of(PLANT_STATE).gaps == 0


def test_stale_after_silence() -> None:
    plant, controller = ToyPlant(), ToyController()
    runner = SimTimeRunner([plant, controller])
    runner.run_for(0.1)
    moved = plant.value
    assert moved > 0.0
    runner.pause_service("wbc")
    runner.run_for(0.09)
    coasted = plant.value
    assert coasted > moved
    runner.run_for(0.5)
    # The command is older than its 100 ms: the plant no longer follows.
    frozen = plant.value
    runner.run_for(0.5)
    assert plant.value == frozen


def test_replaced_service_starts_empty_with_a_new_life() -> None:
    first, second = ToyPlant(every=1), ToyPlant(every=1)
    controller = ToyController()
    runner = SimTimeRunner([first, controller])
    seen: list[PlantState] = []
    runner.on_message(PLANT_STATE, seen.append)
    runner.run_for(0.03)
    runner.replace_service("sim", second)
    assert first.closed
    runner.run_for(0.03)
    assert first.steps == second.steps == 30
    assert [m.header.seq for m in seen] == [*range(30), *range(30)]
    assert seen[0].header.boot != seen[30].header.boot
    status = runner.inbox("wbc").health_of(PLANT_STATE)
    assert (status.gaps, status.late) == (0, 0)
    assert second.seen[0][1] == 30 * MS


def test_a_service_does_not_hear_itself() -> None:
    class Echo(Service):
        name = "echo"
        period_ns = MS
        reads = (TELEOP_GAIT,)
        writes = (TELEOP_GAIT,)
        heard = 0

        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            self.heard += len(inputs.events(TELEOP_GAIT))
            return [Output(TELEOP_GAIT, gait_request(1))]

    echo = Echo()
    other = ToyController()
    SimTimeRunner([echo, other]).run_for(0.021)
    assert echo.heard == 0
    assert len(other.gaits) == 21


def test_what_is_not_declared_is_refused() -> None:
    plant = ToyPlant()
    plant.writes = ()
    with pytest.raises(TrillError, match=r"sim published 'plant/state'; expected one of its"):
        SimTimeRunner([plant]).run_for(0.01)
    with pytest.raises(TrillError, match="different names"):
        SimTimeRunner([ToyPlant(), ToyPlant()])
    with pytest.raises(TrillError, match="offsets"):
        SimTimeRunner([ToyPlant()], offsets_ns={"wbc": 1})
    with pytest.raises(ConfigError, match="no topic"):
        SimTimeRunner([ToyPlant()], links={"plant/stat": "5ms"})
    runner = SimTimeRunner([ToyPlant()])
    with pytest.raises(TrillError, match="no service 'wbc'"):
        runner.pause_service("wbc")
    with pytest.raises(TrillError, match="expected a service named 'sim'"):
        runner.replace_service("sim", ToyController())


def test_a_failing_step_is_not_run_again() -> None:
    class Failing(ToyPlant):
        def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
            self.steps += 1
            if self.steps == 3:
                raise RuntimeError("broken on purpose")
            return []

    plant = Failing()
    runner = SimTimeRunner([plant])
    with pytest.raises(RuntimeError, match="on purpose"):
        runner.run_for(0.01)
    assert runner.now_ns == 2 * MS
    runner.run_until(10 * MS)
    assert plant.steps == 10


def test_context_manager_closes_the_services() -> None:
    plant = ToyPlant()
    with SimTimeRunner([plant]) as runner:
        runner.run_for(0.001)
        assert not plant.closed
    assert plant.closed


def test_closed_loop_converges_as_computed_by_hand() -> None:
    """The same loop without any runner: state every 5 ms, command every 10 ms, no delay."""
    plant = ToyPlant()
    SimTimeRunner([plant, ToyController()]).run_for(0.5)
    value, published, command = 0.0, None, None
    for step in range(500):
        if command is not None:
            value += 0.01 * (command - value)
        if (step + 1) % 5 == 0:
            published = value
        if step % 10 == 0 and published is not None:
            command = published + 1.0
    assert plant.value == pytest.approx(value, rel=1e-12)
    assert np.isfinite(plant.value)
