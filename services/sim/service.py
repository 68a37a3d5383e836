"""The simulated plant as a service."""

import logging
from collections import deque
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Self

from common.plant.config import PHYSICS_RATE, PHYSICS_STEP_NS
from common.plant.stop import StopRecord, load_stop, save_stop
from common.runtime.service import Inputs, Output, Service
from common.schemas import (
    GuardMode,
    JointCommand,
    PlantAction,
    PlantRequest,
    Sender,
    TaskVerdict,
)
from common.tables import overlaid, validated
from common.topics import (
    ESTOP,
    ESTOP_CLEAR,
    PLANT_REQUEST,
    PLANT_STATE,
    PLANT_STATUS,
    PLANT_TRUTH,
    TASK_SCENE,
    TASK_STATUS,
    WBC_COMMAND,
    Topic,
)
from services.sim.config import SimConfig
from services.sim.errors import PlantDivergedError
from services.sim.physics.pace import Pace, RateTimer
from services.sim.physics.plant import Plant
from services.sim.status import RefusalLog, plant_status

_LOG = logging.getLogger(__name__)


class PlantService(Service):
    """Runs a :class:`Plant` at the pace of its runner.

    It publishes the measured state at a rate in robot time, hence not while paused; ground truth
    and status at rates of the runner's clock, so that a paused plant can still be seen; the state
    of a scene that moves right before the ground truth and with the same stamp, so that pictures
    show one moment; and the task's status at its rate and at every change.

    Attributes:
        plant: the plant.
        paused: whether robot time stands still.
    """

    name = "sim"
    reads = (WBC_COMMAND, PLANT_REQUEST, ESTOP, ESTOP_CLEAR)
    writes: tuple[Topic[Any], ...] = (PLANT_STATE, PLANT_TRUTH, PLANT_STATUS)

    def __init__(self, config: SimConfig | None = None, stop: StopRecord | None = None) -> None:
        """Prepare a plant.

        Args:
            config: its configuration.
            stop: emergency stops before it; None: those in its file, if it keeps one.
        """
        config = config or SimConfig()
        latch = config.guard.latch_file
        self._latch_file = Path(latch) if latch else None
        if stop is None and self._latch_file is not None:
            stop = load_stop(self._latch_file)
        self.plant = Plant(config, stop)
        self._kept_stop = self.plant.guard.stop
        if self._kept_stop.latched:
            _LOG.warning(
                "comes up stopped, by %s: %s; trill resume ends it",
                self._kept_stop.by,
                self._kept_stop.reason,
            )
        config = self.plant.config
        topics: list[Topic[Any]] = [PLANT_STATE, PLANT_TRUTH, PLANT_STATUS]
        topics += [TASK_SCENE] * self.plant.view.moves
        topics += [TASK_STATUS] * (self.plant.trial is not None)
        self.writes = tuple(topics)
        # The record at the start decides what the plant does, so that a replay needs it.
        self.settings = config.model_dump(mode="json") | {"stop": self._kept_stop.model_dump()}
        self.period_ns = config.physics_steps * PHYSICS_STEP_NS
        self.paused = False
        self._state_every = PHYSICS_RATE // config.state_rate
        self._state_due = False
        self._state_ns = -1
        self._mode = self.plant.guard.mode
        self._seen: dict[Sender, JointCommand] = {}
        self._divergences = 0
        self._physics_steps, self._catch_up_steps = config.physics_steps, config.catch_up_steps
        self._pace = Pace(config.physics_steps, config.catch_up_steps)
        self._truth_due = RateTimer(config.truth_rate)
        self._status_due = RateTimer(config.status_rate)
        self._task_due = RateTimer(round(TASK_STATUS.rate))
        self._timers = [self._truth_due, self._status_due]
        self._timers += [self._task_due] * (self.plant.trial is not None)
        self._task_reported: tuple[object, ...] = ()
        self._refusals_due = RateTimer(1)
        self._refusals = RefusalLog()
        self._progress: deque[tuple[int, int]] = deque(maxlen=config.status_rate + 1)

    @classmethod
    def from_settings(cls, settings: Mapping[str, Any]) -> Self:
        """Build the plant for a replay; it keeps no file of stops."""
        config = {key: value for key, value in settings.items() if key != "stop"}
        return cls(
            validated(SimConfig, overlaid(config, {"guard": {"latch_file": ""}})),
            validated(StopRecord, settings.get("stop", {})),
        )

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Handle requests and the newest command, run the physics steps due, and report."""
        return self.step_until(inputs, now_ns, now_ns)[1]

    def step_until(
        self, inputs: Inputs, now_ns: int, until_ns: int
    ) -> tuple[int, Sequence[Output]]:
        """Step as :meth:`step` does, and on without inputs up to the first output."""
        self._keep_stop()
        self._take_stops(inputs)
        for request in inputs.events(PLANT_REQUEST):
            self._handle(request)
        if inputs.updated(WBC_COMMAND):
            self._offer(inputs.latest_by_sender(WBC_COMMAND))
        if self.paused:
            self._pace.skip(now_ns)
        else:
            now_ns = self._advance(now_ns, until_ns)
        return now_ns, self._report(now_ns)

    def _report(self, now_ns: int) -> list[Output]:
        """Return what is due, and at once what a change of the guard's mode makes urgent."""
        plant, guard = self.plant, self.plant.guard
        outputs = []
        changed = guard.mode is not self._mode
        if changed and GuardMode.ESTOP in (guard.mode, self._mode):
            self._state_due = True
        self._mode = guard.mode
        # No two states have the same stamp, also while paused.
        if self._state_due and plant.now_ns > self._state_ns:
            self._state_due, self._state_ns = False, plant.now_ns
            outputs.append(Output(PLANT_STATE, plant.measured()))
        if self._truth_due.due(now_ns):
            outputs += self._ground_truth()
        outputs += self._task_status(now_ns)
        due = self._status_due.due(now_ns)
        if due:
            self._progress.append((now_ns, plant.now_ns))
        if due or changed:
            status = plant_status(
                plant,
                paused=self.paused,
                real_time_factor=self._real_time_factor(),
                late_steps=self._pace.late_steps,
                divergences=self._divergences,
            )
            outputs.append(Output(PLANT_STATUS, status))
        if self._refusals_due.due(now_ns):
            self._refusals.log(self.plant.guard)
        return outputs

    def close(self) -> None:
        """Keep the last stop."""
        self._keep_stop()

    def _take_stops(self, inputs: Inputs) -> None:
        """Latch the emergency stop, note the buttons that are there, clear."""
        guard, now_ns = self.plant.guard, self.plant.now_ns
        for clear in inputs.events(ESTOP_CLEAR):
            source = clear.header.source
            if guard.clear(clear.stops, now_ns):
                _LOG.warning("stop %d cleared by %s: %s", clear.stops, source, clear.reason)
            else:
                _LOG.warning("stop %d is not latched, %s cleared nothing", clear.stops, source)
        # Last, so that a stop outdoes a clear of the same moment.
        for button in inputs.events(ESTOP):
            if not button.pressed:
                guard.beat(now_ns)
            else:
                if not guard.stop.latched:
                    _LOG.warning("STOPPED by %s: %s", button.header.source, button.reason)
                guard.estop(button.header.source, button.reason)

    def _keep_stop(self) -> None:
        """Write the stop down, one step after it took effect and was told: a disk may be slow."""
        stop = self.plant.guard.stop
        if stop is self._kept_stop or self._latch_file is None:
            return
        self._kept_stop = stop
        try:
            save_stop(self._latch_file, stop)
        except OSError as error:
            _LOG.error("a restart will forget the stop: %s: %s", self._latch_file, error.strerror)

    def _offer(self, commands: dict[Sender, JointCommand]) -> None:
        """Offer the commands that are new; two controllers must not hide each other."""
        for sender, command in commands.items():
            if self._seen.get(sender) is not command:
                self.plant.offer(command)
        self._seen = commands

    def _ground_truth(self) -> list[Output]:
        """Return the scene, then the robot: whoever waits for the robot then has both."""
        plant, outputs = self.plant, []
        if plant.view.moves and self.wanted(TASK_SCENE):
            scene = plant.view.state(plant.now_ns, plant.reset_count)
            outputs.append(Output(TASK_SCENE, scene))
        if self.wanted(PLANT_TRUTH):
            outputs.append(Output(PLANT_TRUTH, plant.truth()))
        return outputs

    def _task_status(self, now_ns: int) -> list[Output]:
        """Return the task's status if it is due or has changed."""
        plant, trial = self.plant, self.plant.trial
        if trial is None:
            return []
        judge = trial.judge
        current = (plant.reset_count, *judge.progress)
        changed = current != self._task_reported
        if not self._task_due.due(now_ns) and not changed:
            return []
        if changed and judge.verdict is not TaskVerdict.RUNNING:
            _LOG.info("%s: %s: %s", trial.task.name, judge.verdict.name, judge.reason)
        self._task_reported = current
        return [Output(TASK_STATUS, trial.status(plant.now_ns, plant.reset_count))]

    def _advance(self, now_ns: int, until_ns: int) -> int:
        """Run the physics of the step at ``now_ns`` and of quiet ones; return the last's time."""
        plant, size, begun = self.plant, self._physics_steps, self.plant.steps
        due = self._pace.due(now_ns)
        left = due + size * self._quiet_steps(due, now_ns, until_ns)
        diverged = False
        try:
            while left:
                plant.advance(left)
                # After a change only the step in which it happened is completed.
                beyond = plant.steps - begun - due
                left = -beyond if beyond < 0 else -beyond % size
        except PlantDivergedError as error:
            _LOG.exception("resetting: %s", error)
            self._divergences += 1
            diverged = True
        quiet = max(0, -((begun + due - plant.steps) // size))
        if plant.steps // self._state_every > begun // self._state_every:
            self._state_due = True
        if diverged:
            self._reset()
        if quiet:
            now_ns += quiet * self.period_ns
            self._pace.due(now_ns)
        return now_ns

    def _quiet_steps(self, due: int, now_ns: int, until_ns: int) -> int:
        """Return how many steps can follow before ``until_ns``, only the last with an output.

        Args:
            due: physics steps of the step at ``now_ns``.
            now_ns: time of this step [ns].
            until_ns: without inputs before this time [ns].
        """
        if self._state_due or self.plant.guard.mode is not self._mode:
            return 0
        output_ns = min(timer.next_ns for timer in self._timers)
        last_ns = min(until_ns - 1, output_ns + self.period_ns - 1)
        to_state = self._state_every - self.plant.steps % self._state_every - due
        physics = min(to_state + self._physics_steps - 1, self._catch_up_steps)
        return max(0, min((last_ns - now_ns) // self.period_ns, physics // self._physics_steps))

    def _reset(self, seed: int | None = None) -> None:
        self.plant.reset(seed)
        self._state_due = True

    def _handle(self, request: PlantRequest) -> None:
        _LOG.info("%s", request.action.name)
        if request.action is PlantAction.RESET:
            self._reset(request.seed if request.seed >= 0 else None)
        elif request.action is PlantAction.PUSH:
            self.plant.push(request.force, request.duration)
        else:
            self.paused = request.action is PlantAction.PAUSE

    def _real_time_factor(self) -> float:
        """Return robot time passed per time of the runner's clock, over the last second."""
        (first_now, first_robot), (last_now, last_robot) = self._progress[0], self._progress[-1]
        passed = last_now - first_now
        return (last_robot - first_robot) / passed if passed else 0.0
