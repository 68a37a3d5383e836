"""The keyboard operator as a service."""

from collections.abc import Sequence

from common.operator.claim import own_replies
from common.runtime.service import Inputs, Output, Service
from common.schemas import Sender
from common.topics import (
    CAMERA_LEFT,
    ESTOP,
    ESTOP_CLEAR,
    PLANT_REQUEST,
    PLANT_STATUS,
    TELEOP_CLAIM,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    TELEOP_STATUS,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.teleop.keyboard.config import KeyboardConfig
from services.teleop.keyboard.console import Console
from services.teleop.keyboard.decoder import KeyDecoder
from services.teleop.keyboard.screen import Feedback, render
from services.teleop.keyboard.terminal import Screen

PERIOD_NS = 50_000_000
"""Set-points at 20 Hz."""
STOP_PATIENCE_NS = 2_000_000_000
"""Time for which leaving waits for the confirmation of an emergency stop [ns]."""
LONGEST_STEP = 0.1
"""Largest time by which one step moves the targets [s]."""


class KeyboardOperator(Service):
    """Publishes set-points at 20 Hz while it has the robot, and requests of the keys.

    It takes the robot by a key only: Enter, or one that moves the robot while nobody has it. Until
    then it follows the controller's target, and so starts without a jump. Emergency stop, reset and
    pause always work. When it ends it does not give the robot back: the hands rest, and nobody gets
    it by itself. Request ids start at the runner's clock in milliseconds.

    It shows no pictures, but the delay of the left camera's behind the robot, with which a person
    would see.
    """

    # Not "teleop": it may run beside a scripted operator, which has that name and port.
    name = "keyboard"
    period_ns = PERIOD_NS
    reads = (
        WBC_STATE,
        WBC_REPLY,
        WBC_AUTHORITY,
        WBC_TARGET,
        PLANT_STATUS,
        TELEOP_STATUS,
        CAMERA_LEFT,
    )
    writes = (TELEOP_CLAIM, TELEOP_SETPOINT, TELEOP_GAIT, PLANT_REQUEST, ESTOP, ESTOP_CLEAR)

    def __init__(self, screen: Screen, config: KeyboardConfig | None = None) -> None:
        """Read keys from and draw on ``screen``."""
        self.console = Console(config or KeyboardConfig())
        self._screen = screen
        self._decoder = KeyDecoder()
        self._last_ns: int | None = None
        self._drawn: list[str] = []
        self._falls = 0
        self._was_fallen = False

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Handle keys, advance and draw; see :class:`common.runtime.service.Service`."""
        if self._last_ns is None:
            self._last_ns = now_ns - self.period_ns
            self.console.next_id = now_ns // 1_000_000
        now = now_ns * 1e-9
        dt = min((now_ns - self._last_ns) * 1e-9, LONGEST_STEP)
        self._last_ns = now_ns

        feedback, console = self._feedback(inputs), self.console
        console.claimant.update(inputs, Sender(self.name, self.boot), stopped=console.stopped)
        console.update_requests(own_replies(inputs.events(WBC_REPLY), self.boot), now)
        if feedback.controller is not None:
            console.note_controller(feedback.controller.header.boot, now)
        stamp = 0 if feedback.controller is None else feedback.controller.header.stamp
        target = inputs.latest(WBC_TARGET) if inputs.fresh(WBC_TARGET) else None
        outputs = console.follow(target, now, stamp)
        outputs += self._keys(now, stamp)
        outputs += console.claimant.claims(now_ns, stamp)
        if console.claimant.has_robot:
            console.targets.advance(dt)
            outputs.append(Output(TELEOP_SETPOINT, console.targets.setpoint(stamp)))
        heard = feedback.plant if inputs.updated(PLANT_STATUS) else None
        stops = [Output(ESTOP, stop) for stop in console.button.poll(now_ns, heard, stamp)]
        pressed_ns = console.button.pressed_ns
        if console.quit and (pressed_ns is None or now_ns - pressed_ns > STOP_PATIENCE_NS):
            self.exit_code = 0
        lines = render(console, feedback, now)
        if lines != self._drawn:
            self._drawn = lines
            self._screen.draw(lines)
        # First what is most urgent.
        return stops + outputs

    def close(self) -> None:
        """Restore the terminal."""
        self._screen.close()

    def _keys(self, now: float, stamp: int) -> list[Output]:
        data = self._screen.read()
        if data is None:
            self.console.quit = True
            return []
        outputs: list[Output] = []
        for key in self._decoder.feed(data):
            outputs += self.console.press(key, now, stamp)
        return outputs

    def _feedback(self, inputs: Inputs) -> Feedback:
        plant, script = inputs.latest(PLANT_STATUS), inputs.latest(TELEOP_STATUS)
        self.console.plant = plant if inputs.fresh(PLANT_STATUS) else None
        if plant is not None:
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
