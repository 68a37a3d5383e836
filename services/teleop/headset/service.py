"""The operator in a browser or a headset as a service."""

from collections.abc import Callable, Sequence

from common.operator.claim import own_replies
from common.robot.joints import NECK
from common.runtime.service import Inputs, Output, Service
from common.schemas import CameraFrame, GaitOutcome, Sender
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    ESTOP,
    ESTOP_CLEAR,
    PLANT_REQUEST,
    PLANT_STATE,
    PLANT_STATUS,
    TASK_STATUS,
    TELEOP_CLAIM,
    TELEOP_DEVICE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_AUTHORITY,
    WBC_REPLY,
    WBC_STATE,
    WBC_TARGET,
)
from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.driver import Driver, Moment
from services.teleop.headset.hub import Hub, Picture
from services.teleop.headset.status import Feedback, describe

PERIOD_NS = 10_000_000
"""A sample, a key or a picture waits no longer than this."""
SETPOINT_PERIOD_NS = 30_000_000
"""Set-points at 33 Hz: the controller takes those that come more than 25 ms apart for what they
are, and a pose waits half as long for the next one as at 20 Hz."""
STATUS_PERIOD_NS = 50_000_000
LONGEST_STEP = 0.1
"""Largest time by which one step moves the targets [s]."""
KEPT = 100
"""Pictures whose robot time is remembered, 5 s."""


class HeadsetOperator(Service):
    """Publishes what the person at the driving page does, while this operator has the robot.

    Pages exchange messages with it through its hub; who drives is decided by :class:`Driver`.
    While no page drives it neither claims the robot nor sends set-points: a robot that it had is
    taken from it by the controller, and no other operator gets it by itself. Request ids start at
    the runner's clock in milliseconds.

    Attributes:
        driver: the person.
        hub: exchange with the pages.
    """

    name = "headset"
    period_ns = PERIOD_NS
    reads = (
        WBC_STATE,
        WBC_REPLY,
        WBC_AUTHORITY,
        WBC_TARGET,
        PLANT_STATE,
        PLANT_STATUS,
        CAMERA_LEFT,
        CAMERA_RIGHT,
        TASK_STATUS,
    )
    writes = (
        TELEOP_CLAIM,
        TELEOP_DEVICE,
        TELEOP_SETPOINT,
        TELEOP_GAIT,
        PLANT_REQUEST,
        ESTOP,
        ESTOP_CLEAR,
    )

    def __init__(
        self,
        config: HeadsetConfig | None = None,
        hub: Hub | None = None,
        on_close: Callable[[], None] = lambda: None,
    ) -> None:
        """Exchange messages with pages through ``hub``; ``on_close`` ends its server."""
        self.driver = Driver(config or HeadsetConfig())
        self.hub = hub or Hub()
        self._on_close = on_close
        self._last_ns: int | None = None
        self._setpoint_due_ns = self._status_due_ns = 0
        self._shown: dict[int, int] = {}
        self._number = 0
        self._no_pictures = ""

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Take in what the pages sent, and tell them; see :class:`Service`."""
        if self._last_ns is None:
            self._last_ns = now_ns - self.period_ns
            self.driver.console.next_id = now_ns // 1_000_000
        dt = min((now_ns - self._last_ns) * 1e-9, LONGEST_STEP)
        self._last_ns = now_ns
        state, plant = inputs.latest(PLANT_STATE), inputs.latest(PLANT_STATUS)
        controller = inputs.latest(WBC_STATE)
        stamp = 0 if controller is None else controller.header.stamp
        neck = 0.0 if state is None else float(state.joint_position[NECK.start])
        moment = Moment(now_ns, stamp, neck, self._shown)
        self.driver.console.plant = plant if inputs.fresh(PLANT_STATUS) else None
        outputs = self._follow(inputs, moment)
        for event in self.hub.drain():
            outputs += self.driver.handle(event, moment)
        outputs += self._drive(moment, dt)
        # First what is most urgent.
        outputs = [*self._stops(inputs, moment), *outputs]
        self._show_pictures(inputs, moment)
        if now_ns >= self._status_due_ns:
            self._status_due_ns = now_ns + STATUS_PERIOD_NS
            self._show_status(inputs, moment)
        return outputs

    def close(self) -> None:
        """End the server."""
        self._on_close()

    def _follow(self, inputs: Inputs, moment: Moment) -> list[Output]:
        """Take in who has the robot and what became of requests."""
        console = self.driver.console
        console.claimant.update(inputs, Sender(self.name, self.boot), stopped=console.stopped)
        replies = own_replies(inputs.events(WBC_REPLY), self.boot)
        console.update_requests(replies, moment.now)
        failed = {GaitOutcome.REFUSED, GaitOutcome.ABORTED}
        if self.driver.page in self.driver.pages:
            page = self.driver.pages[self.driver.page]
            page.refusals += sum(reply.outcome in failed for reply in replies)
        controller = inputs.latest(WBC_STATE)
        if controller is not None:
            console.note_controller(controller.header.boot, moment.now)
        target = inputs.latest(WBC_TARGET) if inputs.fresh(WBC_TARGET) else None
        if target is not None and not console.claimant.has_robot:
            self.driver.start_from(target)
        return console.follow(target, moment.now, moment.stamp)

    def _drive(self, moment: Moment, dt: float) -> list[Output]:
        """Return claim and set-point, if a page drives."""
        driver, claimant = self.driver, self.driver.console.claimant
        driver.advance(dt, moment.now)
        alive = driver.alive(moment.now_ns)
        outputs: list[Output] = []
        if alive or not claimant.wants:
            outputs += claimant.claims(moment.now_ns, moment.stamp)
        if alive and claimant.has_robot and moment.now_ns >= self._setpoint_due_ns:
            self._setpoint_due_ns = moment.now_ns + SETPOINT_PERIOD_NS
            outputs.append(Output(TELEOP_SETPOINT, driver.setpoint(self._seen(moment))))
        return outputs

    def _seen(self, moment: Moment) -> int:
        """Return the robot time of what the person saw [ns]."""
        if self.driver.page is None:
            return moment.stamp
        return self.driver.pages[self.driver.page].saw(moment.stamp)

    def _stops(self, inputs: Inputs, moment: Moment) -> list[Output]:
        """Return the state of the emergency stop button; without a page there is no button."""
        button = self.driver.console.button
        if button.pressed_ns is None and not self.driver.watched(moment.now_ns):
            return []
        heard = inputs.latest(PLANT_STATUS) if inputs.updated(PLANT_STATUS) else None
        return [Output(ESTOP, stop) for stop in button.poll(moment.now_ns, heard, moment.stamp)]

    def _show_pictures(self, inputs: Inputs, moment: Moment) -> None:
        """Hand new pictures to the pages, and note what is wrong with them."""
        if not (inputs.fresh(CAMERA_LEFT) and inputs.fresh(CAMERA_RIGHT)):
            self._no_pictures = "no pictures: the cameras are silent"
            return
        if not inputs.updated(CAMERA_LEFT) and not inputs.updated(CAMERA_RIGHT):
            return
        pair = inputs.latest_pair(CAMERA_LEFT, CAMERA_RIGHT)
        if pair is None:
            self._no_pictures = "no pictures: left and right are of different times"
        elif any(picture.encoding != "jpeg" for picture in pair):
            self._no_pictures = 'no pictures: they are raw; expected [cameras] encoding = "jpeg"'
        else:
            self._no_pictures = ""
            if pair[0].header.stamp != self._shown.get(self._number):
                self._show_picture(*pair, moment, inputs.age(WBC_STATE))

    def _show_picture(
        self, left: CameraFrame, right: CameraFrame, moment: Moment, state_age: float
    ) -> None:
        stamp = left.header.stamp
        self._number += 1
        self._shown[self._number] = stamp
        self._shown.pop(self._number - KEPT, None)
        age = max(0.0, 1e-9 * (moment.stamp - stamp)) + (state_age if moment.stamp else 0.0)
        self.hub.show_picture(
            Picture(self._number, stamp, moment.neck, age, moment.now_ns, left.data, right.data)
        )

    def _show_status(self, inputs: Inputs, moment: Moment) -> None:
        driver, refusals = self.driver, self.hub.refusals
        refusals.late = driver.late
        fresh = inputs.fresh
        feedback = Feedback(
            controller=inputs.latest(WBC_STATE) if fresh(WBC_STATE) else None,
            plant=driver.console.plant,
            task=inputs.latest(TASK_STATUS) if fresh(TASK_STATUS) else None,
            neck=moment.neck,
            cameras=self._no_pictures,
            refusals=refusals,
        )
        replies = {number: driver.reply(number, moment.now_ns) for number in driver.pages}
        self.hub.show(describe(driver, feedback, moment.now_ns), replies)
