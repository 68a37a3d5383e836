"""The keyboard operator as a service."""

from collections.abc import Sequence

from common.runtime.service import Inputs, Output, Service
from common.schemas import OperatorStatus
from common.topics import (
    CAMERA_LEFT,
    ESTOP,
    PLANT_REQUEST,
    PLANT_STATUS,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_REPLY,
    WBC_STATE,
)
from services.teleop.keyboard.console import Console, KeyboardConfig
from services.teleop.keyboard.keymap import KeyDecoder
from services.teleop.keyboard.screen import Feedback, render
from services.teleop.keyboard.terminal import Screen

PERIOD_NS = 50_000_000
"""Set-points at 20 Hz."""
LONGEST_STEP = 0.1
"""Largest time by which one step moves the targets [s]."""
LISTENING = 1.0
"""Time at the start to detect another operator [s]."""


class KeyboardOperator(Service):
    """Publishes set-points at 20 Hz, and requests of the keys.

    In its first second, and while a script is running, it only watches: it sends nothing that moves
    the robot, follows the other operator's set-points, and then takes over from them without a
    jump. Emergency stop, reset and pause always work. Request ids start at the runner's clock in
    milliseconds.

    It shows no pictures, but the delay of the left camera's behind the robot, with which a person
    would see.
    """

    # Not "teleop": it may run beside a scripted operator, which has that name and port.
    name = "keyboard"
    period_ns = PERIOD_NS
    reads = (WBC_STATE, WBC_REPLY, PLANT_STATUS, TELEOP_STATUS, TELEOP_SETPOINT, CAMERA_LEFT)
    writes = (TELEOP_SETPOINT, TELEOP_GAIT, PLANT_REQUEST, ESTOP)

    def __init__(self, screen: Screen, config: KeyboardConfig | None = None) -> None:
        """Read keys from and draw on ``screen``."""
        self.console = Console(config or KeyboardConfig())
        self._screen = screen
        self._decoder = KeyDecoder()
        self._start_ns: int | None = None
        self._last_ns = 0
        self._drawn: list[str] = []
        self._falls = 0
        self._was_fallen = False

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Handle keys, advance and draw; see :class:`common.runtime.service.Service`."""
        if self._start_ns is None:
            self._start_ns, self._last_ns = now_ns, now_ns - self.period_ns
            self.console.next_id = now_ns // 1_000_000
        now = (now_ns - self._start_ns) * 1e-9
        dt = min((now_ns - self._last_ns) * 1e-9, LONGEST_STEP)
        self._last_ns = now_ns

        feedback = self._feedback(inputs)
        self._arbitrate(inputs, feedback.script, now)
        self.console.update_requests(inputs.events(WBC_REPLY), now)
        stamp = 0 if feedback.controller is None else feedback.controller.header.stamp
        outputs = self._keys(now, stamp)
        if not self.console.watching:
            self.console.targets.advance(dt)
            outputs.append(Output(TELEOP_SETPOINT, self.console.targets.setpoint(stamp)))
        lines = render(self.console, feedback, now)
        if lines != self._drawn:
            self._drawn = lines
            self._screen.draw(lines)
        return outputs

    def close(self) -> None:
        """Restore the terminal."""
        self._screen.close()

    def _keys(self, now: float, stamp: int) -> list[Output]:
        data = self._screen.read()
        if data is None:
            self.exit_code = 0
            return []
        outputs: list[Output] = []
        for key in self._decoder.feed(data):
            outputs += self.console.press(key, now, stamp)
        if self.console.quit:
            self.exit_code = 0
        return outputs

    def _feedback(self, inputs: Inputs) -> Feedback:
        plant, script = inputs.latest(PLANT_STATUS), inputs.latest(TELEOP_STATUS)
        if plant is not None:
            self.console.paused = plant.paused
            self._falls += plant.fallen and not self._was_fallen
            self._was_fallen = plant.fallen
        running = script is not None and inputs.fresh(TELEOP_STATUS) and not script.finished
        return Feedback(
            controller=inputs.latest(WBC_STATE),
            controller_age=inputs.age(WBC_STATE),
            plant=plant,
            plant_age=inputs.age(PLANT_STATUS),
            script=script if running else None,
            falls=self._falls,
            picture_delay=self._picture_delay(inputs),
        )

    @staticmethod
    def _picture_delay(inputs: Inputs) -> float | None:
        """Return the left picture's delay behind the robot in robot time [s]; None: no picture."""
        controller, picture = inputs.latest(WBC_STATE), inputs.latest(CAMERA_LEFT)
        if controller is None or picture is None or not inputs.fresh(CAMERA_LEFT):
            return None
        return max(0.0, 1e-9 * (controller.header.stamp - picture.header.stamp))

    def _arbitrate(self, inputs: Inputs, script: OperatorStatus | None, now: float) -> None:
        """Decide whether this operator commands or only watches."""
        other = inputs.latest(TELEOP_SETPOINT) if inputs.fresh(TELEOP_SETPOINT) else None
        watched = self.console.watching
        if script is not None:
            self.console.watching = f"the script {script.script!r} has the robot"
        elif now < LISTENING:
            self.console.watching = "listening for other operators"
        else:
            self.console.watching = ""
        if (self.console.watching or watched) and other is not None:
            self.console.targets.adopt(other)
            if not self.console.watching:
                self.console.notice = f"taking over from {other.header.source or 'another'}"
