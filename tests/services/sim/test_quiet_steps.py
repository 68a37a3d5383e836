"""Steps of the plant that are done at once in simulated time change nothing of what it says."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from common.journal.journal import PERIOD_NS
from common.plant import servo
from common.plant.servo import Target
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import Estop, EstopClear, GuardMode, PlantAction, PlantRequest
from common.topics import (
    ESTOP,
    ESTOP_CLEAR,
    JOURNAL,
    PLANT_REQUEST,
    PLANT_STATE,
    PLANT_STATUS,
    WBC_COMMAND,
)
from common.wire import codec, template
from services.sim.config import TYPICAL_NOISE, SimConfig
from services.sim.physics import steps
from services.sim.physics.steps import PhysicsSteps
from services.sim.service import PlantService
from tests.services.sim.support import MS, Stander


class CountedPlant(PlantService):
    """Counts how often its runner calls it."""

    calls = 0

    def step_until(
        self, inputs: Inputs, now_ns: int, until_ns: int
    ) -> tuple[int, Sequence[Output]]:
        self.calls += 1
        return super().step_until(inputs, now_ns, until_ns)


class StepByStep(CountedPlant):
    """Does one step at a time."""

    def step_until(
        self, inputs: Inputs, now_ns: int, until_ns: int
    ) -> tuple[int, Sequence[Output]]:
        return super().step_until(inputs, now_ns, now_ns)


class Commander(Service):
    """Lets the robot stand for a while and then is silent."""

    name = "wbc"
    period_ns = 10 * MS
    reads = (PLANT_STATE,)
    writes = (WBC_COMMAND,)

    def __init__(self, stander: Stander, silent_from_ns: int) -> None:
        self._stander, self._silent_from_ns = stander, silent_from_ns

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        state = inputs.latest(PLANT_STATE)
        if state is None or now_ns >= self._silent_from_ns:
            return []
        return [Output(WBC_COMMAND, self._stander.command(state))]


def eventful_run(kind: type[CountedPlant], links: Any = None, **config: Any) -> SimTimeRunner:
    """Command, stop, clear, push, pause, reset, silence: whatever ends a quiet time."""
    service = kind(SimConfig(noise=TYPICAL_NOISE, seed=3, **config))
    commander = Commander(Stander(service.plant), 600 * MS)
    runner = SimTimeRunner([service, commander], seed=1, links=links, record=True)

    def request(action: PlantAction, **values: Any) -> None:
        runner.inject(PLANT_REQUEST, PlantRequest(action=action, **values))

    runner.run_for(0.2033)
    request(PlantAction.PUSH, force=np.array([40.0, 0.0, 0.0]), duration=0.013)
    runner.run_for(0.1)
    runner.inject(ESTOP, Estop(reason="test"))
    runner.run_for(0.0171)
    runner.inject(ESTOP_CLEAR, EstopClear(reason="test", stops=1))
    runner.run_for(0.1)
    request(PlantAction.PAUSE)
    runner.run_for(0.0313)
    request(PlantAction.RESUME)
    runner.run_for(0.05)
    runner.pause_service("sim")
    runner.run_for(0.0312)
    runner.resume_service("sim")
    runner.run_for(0.35)
    request(PlantAction.RESET, seed=8)
    runner.run_for(0.1)
    return runner


def plant_of(runner: SimTimeRunner) -> CountedPlant:
    """The plant in ``runner``."""
    service = runner._host("sim").service
    assert isinstance(service, CountedPlant)
    return service


@pytest.mark.parametrize(
    ("config", "links", "share"),
    [
        ({}, {"wbc:plant/state": "5ms", "sim:wbc/command": "normal(6ms, 3ms)"}, 0.5),
        ({"state_rate": 50, "truth_rate": 250, "catch_up_steps": 7}, None, 0.5),
        ({"physics_steps": 3, "state_rate": 40}, None, 0.7),
        ({"task": "hardware/tool"}, None, 0.35),
    ],
)
def test_the_record_is_the_same_to_the_byte(config: Any, links: Any, share: float) -> None:
    at_once, one_by_one = (
        eventful_run(kind, links, **config) for kind in (CountedPlant, StepByStep)
    )
    assert at_once.log == one_by_one.log
    assert plant_of(at_once).calls < share * plant_of(one_by_one).calls


@pytest.mark.skipif(steps._steps is None, reason="the kernel is not built")
@pytest.mark.parametrize("config", [{}, {"task": "hardware/tool"}], ids=["flat", "task"])
def test_the_record_is_the_same_without_compiled_code(
    config: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    compiled = eventful_run(CountedPlant, **config)
    monkeypatch.setattr(steps, "_steps", None)
    monkeypatch.setattr(servo, "_servo", None)
    monkeypatch.setattr(codec, "_codec", None)
    monkeypatch.setattr(template, "_template", None)
    assert eventful_run(CountedPlant, **config).log == compiled.log


def test_a_guard_that_changes_its_mode_tells_it_at_once() -> None:
    told: list[tuple[int, GuardMode]] = []
    service = CountedPlant(SimConfig(status_rate=1))
    runner = SimTimeRunner([service, Commander(Stander(service.plant), 15 * MS)])
    runner.on_message(PLANT_STATUS, lambda s: told.append((s.header.sent // MS, s.guard)))
    runner.run_for(0.2)
    # One command, from the state after ten steps; it comes in at 11 ms and is in force to 110 ms.
    assert told == [(0, GuardMode.SILENT), (11, GuardMode.ACTIVE), (111, GuardMode.HOLD)]


def test_a_divergence_resets_in_its_own_step(monkeypatch: pytest.MonkeyPatch) -> None:
    def run(kind: type[CountedPlant]) -> SimTimeRunner:
        # At the 323rd step, and so on, the state is not a number.
        service, advance, done = kind(SimConfig()), PhysicsSteps.run, 0
        marks = iter((323, 408, 469, 10_000))
        mark = next(marks)

        def stepped(physics: Any, target: Target, now_ns: int, most: int, **how: bool) -> Any:
            nonlocal done, mark
            taken, is_notable = advance(physics, target, now_ns, min(most, mark - done), **how)
            done += taken
            if done == mark:
                service.plant.data.qvel[0] = np.nan
                mark, is_notable = next(marks), True
            return taken, is_notable

        monkeypatch.setattr(PhysicsSteps, "run", stepped)
        runner = SimTimeRunner([service], record=True)
        runner.run_for(0.6)
        monkeypatch.undo()
        return runner

    at_once, one_by_one = run(CountedPlant), run(StepByStep)
    assert plant_of(at_once).plant.reset_count == 3
    assert at_once.log == one_by_one.log


def test_the_journal_is_published_when_it_is_due() -> None:
    sent: list[int] = []
    service = CountedPlant(SimConfig(state_rate=10, truth_rate=1, status_rate=1))
    runner = SimTimeRunner([service], journal=True)
    runner.on_message(JOURNAL, lambda journal: sent.append(journal.header.sent))
    runner.run_for(1.1)
    assert sent == [k * PERIOD_NS for k in range(5)]
    assert service.calls < 100
