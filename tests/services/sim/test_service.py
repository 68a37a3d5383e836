"""The plant on a bus: rates, events, clock and what it reports."""

import json
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pydantic import ValidationError

from common.errors import SchemaError
from common.plant.config import GuardConfig
from common.plant.stop import StopRecord, save_stop
from common.runtime.service import Output
from common.schemas import (
    Estop,
    EstopClear,
    GuardMode,
    Header,
    PlantAction,
    PlantRequest,
    PlantState,
    PlantStatus,
)
from common.topics import (
    ESTOP,
    ESTOP_CLEAR,
    PLANT_REQUEST,
    PLANT_STATE,
    PLANT_STATUS,
    PLANT_TRUTH,
    WBC_COMMAND,
    Topic,
)
from common.wire.codec import decode, encode
from services.sim.config import TYPICAL_NOISE, SimConfig
from services.sim.physics.plant import START_NS
from services.sim.service import PlantService
from tests.services.inputs import FakeInputs

from .support import MS, Stander, make_command


class Bench:
    """Steps a service on a clock of its own and keeps what it says."""

    def __init__(self, **settings: Any) -> None:
        self.service = PlantService(SimConfig(**settings))
        self.inputs = FakeInputs()
        self.now_ns = 77_000 * MS
        self.outputs: list[Output] = []

    def run(self, milliseconds: int, every: int = 1) -> None:
        for _ in range(milliseconds // every):
            self.now_ns += every * MS
            self.outputs += self.service.step(self.inputs, self.now_ns)
            self.inputs.begin_step()

    def ask(self, action: PlantAction, **values: Any) -> None:
        self.inputs.put(PLANT_REQUEST, PlantRequest(action=action, **values))

    def said(self, topic: Topic[Any]) -> list[Any]:
        return [output.message for output in self.outputs if output.topic is topic]

    @property
    def status(self) -> PlantStatus:
        status: PlantStatus = self.said(PLANT_STATUS)[-1]
        return status

    def guard(self) -> GuardMode:
        return self.status.guard

    @property
    def states(self) -> Sequence[PlantState]:
        return self.said(PLANT_STATE)


@pytest.mark.parametrize(("rate", "expected"), [(200, 200), (500, 500)])
def test_rates(rate: int, expected: int) -> None:
    bench = Bench(state_rate=rate)
    bench.run(1000)
    counts = Counter(output.topic.name for output in bench.outputs)
    assert counts == {PLANT_STATE.name: expected, PLANT_TRUTH.name: 50, PLANT_STATUS.name: 10}
    stamps = [state.header.stamp for state in bench.states]
    assert set(np.diff(stamps)) == {1_000_000_000 // rate}
    assert bench.service.period_ns == MS


def test_truth_is_exact_and_state_is_noisy() -> None:
    bench = Bench(noise=TYPICAL_NOISE)
    bench.run(100)
    measured = {state.header.stamp: state for state in bench.states}
    pairs = [
        (t, measured[t.header.stamp])
        for t in bench.said(PLANT_TRUTH)[1:]
        if t.header.stamp in measured
    ]
    assert all(np.abs(t.base_position - m.base_position).max() > 1e-5 for t, m in pairs)
    truth = bench.service.plant.truth()
    assert np.abs(bench.said(PLANT_TRUTH)[-1].base_position - truth.base_position).max() < 1e-3


def test_a_new_command_is_offered_once() -> None:
    bench = Bench()
    bench.run(20)
    bench.inputs.put(WBC_COMMAND, Stander(bench.service.plant).command(bench.states[-1]))
    bench.run(100)
    assert bench.status.commands_applied == 1
    assert bench.guard() is GuardMode.ACTIVE
    bench.run(100)
    assert bench.guard() is GuardMode.HOLD
    assert bench.status.holds == 1


def test_refused_commands_are_counted_and_told_once_a_second(
    caplog: pytest.LogCaptureFixture,
) -> None:
    bench = Bench()
    bench.run(10)
    for _ in range(30):
        bench.inputs.put(WBC_COMMAND, make_command(0))
        bench.run(10)
    bench.run(3000)
    told = [record.message for record in caplog.records]
    assert len(told) == 1
    assert told[0].startswith("refused 30 commands, the last: nameless (boot 0): made from a state")
    assert bench.status.last_refusal in told[0]
    assert (bench.status.commands_applied, bench.status.commands_refused) == (0, 30)
    assert bench.guard() is GuardMode.SILENT


def test_what_a_stopped_robot_refuses_is_told_once(caplog: pytest.LogCaptureFixture) -> None:
    bench = Bench()
    bench.inputs.put(ESTOP, Estop(reason="smoke"))
    for _ in range(30):
        bench.run(100)
        bench.inputs.put(WBC_COMMAND, make_command(bench.service.plant.now_ns))
    assert bench.status.commands_refused >= 29
    assert [record.message.startswith("refused") for record in caplog.records].count(True) == 1


def test_status_tells_the_age_of_the_state_behind_the_torque() -> None:
    bench = Bench()
    bench.run(20)
    stander = Stander(bench.service.plant)
    for k in range(100):
        delay = 30 if k in (50, 80) else 8
        bench.run(delay)
        state = next(
            s
            for s in reversed(bench.states)
            if s.header.stamp <= bench.service.plant.now_ns - delay * MS
        )
        bench.inputs.put(WBC_COMMAND, stander.command(state))
        bench.run(1)
    bench.run(100)
    assert 0.008 <= bench.status.age_at_torque_median <= 0.013
    assert 0.013 < bench.status.age_at_torque_p99 <= 0.035


def test_pause_stops_robot_time_and_state_but_not_truth_and_status() -> None:
    bench = Bench()
    bench.run(50)
    bench.ask(PlantAction.PAUSE)
    bench.run(1)
    before = bench.service.plant.now_ns
    bench.outputs.clear()
    bench.run(2000)
    assert bench.service.plant.now_ns == before
    assert not bench.states
    assert len(bench.said(PLANT_TRUTH)) == 100
    assert bench.status.paused
    assert bench.status.real_time_factor == 0.0
    bench.ask(PlantAction.RESUME)
    bench.run(1200)
    assert bench.service.plant.now_ns == before + 1200 * MS
    assert not bench.status.paused
    assert bench.status.late_steps == 0
    assert bench.status.real_time_factor == pytest.approx(1.0)


def test_a_pause_does_not_age_the_command_in_force() -> None:
    bench = Bench()
    bench.run(20)
    bench.inputs.put(WBC_COMMAND, Stander(bench.service.plant).command(bench.states[-1]))
    bench.run(10)
    bench.ask(PlantAction.PAUSE)
    bench.run(3000)
    assert bench.guard() is GuardMode.ACTIVE


def test_reset_counts_publishes_at_once_and_keeps_time_going() -> None:
    bench = Bench()
    bench.run(498)
    bench.ask(PlantAction.PUSH, force=np.array([300.0, 0.0, 0.0]), duration=0.4)
    bench.run(1500)
    assert bench.status.fallen
    assert bench.guard() is GuardMode.DAMP
    bench.outputs.clear()
    bench.ask(PlantAction.RESET)
    bench.run(1)
    assert [state.reset_count for state in bench.states] == [1]
    bench.run(500)
    stamps = [state.header.stamp for state in bench.states]
    assert all(np.diff(stamps) > 0)
    assert stamps[0] > START_NS + 1998 * MS
    assert not bench.status.fallen
    assert bench.guard() is GuardMode.SILENT


def test_a_push_that_no_robot_survives_is_refused_by_sender_and_receiver() -> None:
    with pytest.raises(ValidationError, match="at most 2000 N, got 3000 N"):
        PlantRequest(action=PlantAction.PUSH, force=np.array([0.0, 3000.0, 0.0]))
    unchecked = PlantRequest.model_construct(
        action=PlantAction.PUSH, force=np.array([0.0, 2001.0, 0.0]), header=Header(seq=1, boot=1)
    )
    with pytest.raises(SchemaError, match="got 2001 N"):
        decode(encode(unchecked, unchecked.header), PlantRequest)
    assert PlantRequest(action=PlantAction.PUSH, force=np.array([2000.0, 0.0, 0.0]))


def pressed(source: str = "keyboard") -> Estop:
    return Estop(header=Header(source=source), reason="smoke")


def clear(stops: int) -> EstopClear:
    return EstopClear(header=Header(source="keyboard"), reason="looked", stops=stops)


def test_a_stop_is_told_at_once_and_ended_by_its_own_clear_only() -> None:
    bench = Bench()
    bench.run(52)
    bench.outputs.clear()
    for _ in range(8):
        bench.inputs.put(ESTOP, pressed())
    bench.run(1)
    (state,), (status,) = bench.states, bench.said(PLANT_STATUS)
    assert state.guard is status.guard is GuardMode.ESTOP
    assert np.abs(state.joint_torque).max() < 1.0, "limp in the same step"
    assert (status.stops, status.stopped_by, status.stop_reason) == (1, "keyboard", "smoke")
    bench.ask(PlantAction.RESET)
    bench.run(150)
    assert bench.states[-1].reset_count == 1
    assert bench.guard() is GuardMode.ESTOP
    bench.inputs.put(ESTOP_CLEAR, clear(2))
    bench.run(1)
    assert bench.guard() is GuardMode.ESTOP
    bench.outputs.clear()
    bench.inputs.put(ESTOP_CLEAR, clear(1))
    bench.run(1)
    assert bench.states[-1].guard is GuardMode.DAMP
    assert bench.guard() is GuardMode.DAMP
    assert (bench.status.stops, bench.status.stopped_by) == (1, "")
    bench.inputs.put(ESTOP_CLEAR, clear(1))
    bench.inputs.put(ESTOP, pressed("headset"))
    bench.run(1)
    assert bench.guard() is GuardMode.ESTOP
    assert bench.status.stops == 2


def test_a_stop_while_paused_repeats_no_stamp() -> None:
    bench = Bench()
    bench.run(52)
    bench.ask(PlantAction.PAUSE)
    bench.run(1)
    bench.inputs.put(ESTOP, pressed())
    bench.run(50)
    assert bench.guard() is GuardMode.ESTOP
    bench.inputs.put(ESTOP_CLEAR, clear(1))
    bench.run(50)
    bench.inputs.put(ESTOP, pressed())
    bench.run(50)
    bench.ask(PlantAction.RESUME)
    bench.run(50)
    stamps = [state.header.stamp for state in bench.states]
    assert np.diff(stamps).min() > 0
    assert bench.states[-1].guard is GuardMode.ESTOP
    assert bench.states[-1].stops == 2, "a stop that ended in the pause is told after it"


def test_a_beat_is_no_stop_and_its_absence_holds() -> None:
    bench = Bench(guard={"stop_beat_timeout": 0.2})
    bench.run(20)
    stander = Stander(bench.service.plant)
    for ms in range(0, 600, 10):
        if ms < 300 and ms % 100 == 0:
            bench.inputs.put(ESTOP, Estop(reason="", pressed=False))
        bench.inputs.put(WBC_COMMAND, stander.command(bench.states[-1]))
        bench.run(10)
        assert bench.service.plant.guard.mode is (GuardMode.ACTIVE if ms < 400 else GuardMode.HOLD)
    assert bench.status.stops == 0
    assert "button" in bench.status.last_refusal


def test_a_restarted_plant_is_still_stopped(tmp_path: Path) -> None:
    path = tmp_path / "estop.json"
    bench = Bench(guard={"latch_file": str(path)})
    bench.inputs.put(ESTOP, pressed())
    bench.run(1)
    assert not path.exists(), "a slow disk does not delay what others hear"
    bench.run(1)
    bench = Bench(guard={"latch_file": str(path)})
    bench.run(1)
    assert bench.guard() is GuardMode.ESTOP
    assert (bench.status.stops, bench.status.stopped_by) == (1, "keyboard")
    bench.inputs.put(ESTOP_CLEAR, clear(1))
    bench.run(1)
    bench.service.close()
    bench = Bench(guard={"latch_file": str(path)})
    bench.run(1)
    assert bench.guard() is GuardMode.SILENT
    assert bench.status.stops == 1


def test_a_plant_that_came_up_stopped_does_so_again_in_a_replay(tmp_path: Path) -> None:
    path = tmp_path / "estop.json"
    save_stop(path, StopRecord(stops=3).pressed("keyboard", "smoke"))
    config = SimConfig().model_copy(update={"guard": GuardConfig(latch_file=str(path))})
    recorded = PlantService(config)
    path.unlink()
    replayed = PlantService.from_settings(json.loads(json.dumps(recorded.settings)))
    assert replayed.plant.guard.mode is GuardMode.ESTOP
    assert replayed.plant.guard.stop == recorded.plant.guard.stop
    # A log from before the record was kept is still replayed.
    settings = {key: value for key, value in recorded.settings.items() if key != "stop"}
    assert PlantService.from_settings(settings).plant.guard.mode is GuardMode.SILENT


def test_a_stop_that_cannot_be_kept_is_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    (tmp_path / "file").write_text("")
    bench = Bench()
    bench.service._latch_file = tmp_path / "file" / "estop.json"
    bench.inputs.put(ESTOP, pressed())
    bench.run(2)
    assert "a restart will forget the stop" in caplog.text
    assert bench.guard() is GuardMode.ESTOP


def test_a_replay_reads_and_writes_no_file(tmp_path: Path) -> None:
    path = tmp_path / "estop.json"
    path.write_text("damaged")
    again = PlantService.from_settings(
        SimConfig.model_validate({"guard": {"latch_file": str(path)}}).model_dump(mode="json")
    )
    assert again.plant.guard.mode is GuardMode.SILENT


def test_a_second_controller_is_refused_and_named_and_hides_nobody() -> None:
    bench = Bench()
    bench.run(20)
    stander = Stander(bench.service.plant)

    def send(source: str, boot: int, **changes: Any) -> None:
        command = stander.command(bench.states[-1])
        header = command.header.model_copy(update={"source": source, "boot": boot})
        bench.inputs.put(WBC_COMMAND, command.model_copy(update={"header": header, **changes}))

    send("wbc", 7)
    bench.run(1)
    for ms in range(500):
        if ms % 10 == 0:
            send("wbc", 7)
        send("stray", 0xABC, torque=np.full(27, 50.0))
        bench.run(1)
    assert (bench.status.controller, bench.status.controller_boot) == ("wbc", 7)
    assert bench.states[-1].controller_boot == 7
    assert bench.status.commands_foreign == bench.status.commands_refused >= 400
    assert "stray (boot abc)" in bench.status.last_refusal
    assert 40 <= bench.status.commands_applied <= 51
    assert bench.status.holds == 0
    bench.run(150)
    assert bench.states[-1].controller_boot == 0
    assert bench.states[-1].guard is GuardMode.HOLD


def test_a_slow_runner_loses_time_and_says_so() -> None:
    bench = Bench(catch_up_steps=20)
    bench.run(3000, every=30)
    # The first call runs one step; each of the other 99 makes up 20 of its 30 steps.
    assert bench.service.plant.now_ns == START_NS + (1 + 99 * 20) * MS
    assert bench.status.late_steps >= 10 * 90
    assert bench.status.real_time_factor == pytest.approx(2 / 3, abs=0.01)


def test_several_physics_steps_per_service_step() -> None:
    bench = Bench(physics_steps=5)
    assert bench.service.period_ns == 5 * MS
    bench.run(1000, every=5)
    assert bench.service.plant.now_ns == START_NS + 1000 * MS
    assert len(bench.states) == 200


def test_divergence_ends_in_a_reset_not_in_a_crash() -> None:
    bench = Bench()
    bench.run(10)
    bench.service.plant.data.qvel[:] = np.nan
    bench.run(150)
    assert bench.states[-1].reset_count == 1
    assert bench.status.divergences == 1
    assert np.isfinite(bench.states[-1].joint_position).all()
