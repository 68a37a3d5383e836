"""The person at one of several open pages who drives the robot; pure, without a network.

One page drives at a time, the others watch. A page gets to drive by a deliberate act of its person:
a key, a drag, a clutch or a button. While another page has the robot only Enter takes it over. A
page that is silent drives no longer: its hands hold, no set-points or claims are sent, and unless
it is back in time the controller takes the robot from this operator.

The keyboard's keys act as in the keyboard operator, whose console this is. Samples of a headset go
through :class:`~services.teleop.headset.mapping.HeadsetMapper`.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from common.robot.pose import Pose
from common.runtime.service import Output
from common.schemas import DeviceInput, Gait, Setpoint
from common.topics import TELEOP_DEVICE
from services.teleop.headset.config import HeadsetConfig
from services.teleop.headset.gestures import TakeGesture, engages, goes_down, stops
from services.teleop.headset.hub import Event
from services.teleop.headset.mapping import Button, HeadsetMapper
from services.teleop.headset.protocol import Away, Drag, Incoming, Key, Punctuality, Sample, Shown
from services.teleop.headset.view import DragStart
from services.teleop.keyboard.console import Console
from services.teleop.keyboard.keymap import BY_KEY, KEYMAP, RequestGait, SelectHands, binding_of

STOP, TAKE = BY_KEY["x"], BY_KEY["Enter"]
LONGEST_LOOK_NS = 1_000_000_000
"""A picture older than this is not what the person acts on [ns]."""
GAIT_KEYS: Mapping[Gait, str] = {
    binding.command.gait: binding.keys[0]
    for binding in KEYMAP
    if isinstance(binding.command, RequestGait)
}


@dataclass
class Page:
    """What is known of an open page.

    Attributes:
        mapper: of its headset.
        heard_ns: when a message came last that was not late [ns].
        echo: page's clock in its last message [ms], and when that came [ns].
        notice: what only this page is told.
        refusals: acts of its person that were refused.
        seen: robot time of the last picture that it drew [ns]; 0: none.
    """

    mapper: HeadsetMapper
    heard_ns: int = 0
    echo: tuple[float, int] | None = None
    notice: str = ""
    refusals: int = 0
    seen: int = 0
    punctuality: Punctuality = field(default_factory=Punctuality)
    device: DeviceInput | None = None
    fresh: bool = False
    taking: TakeGesture = field(default_factory=TakeGesture)

    def saw(self, stamp: int) -> int:
        """Return the robot time of what the person saw [ns], at the robot time ``stamp`` [ns]."""
        # Neither pictures that have ceased nor those of an earlier robot are looked at.
        return self.seen if self.seen and 0 <= stamp - self.seen <= LONGEST_LOOK_NS else stamp


@dataclass
class Moment:
    """When and on what a person acts.

    Attributes:
        now_ns: operator's time [ns].
        stamp: last known robot time [ns].
        neck: pitch of the robot's head [rad].
        shown: robot times of the last pictures by number [ns].
    """

    now_ns: int
    stamp: int = 0
    neck: float = 0.0
    shown: Mapping[int, int] = field(default_factory=dict)

    @property
    def now(self) -> float:
        """Operator's time [s]."""
        return 1e-9 * self.now_ns


class Driver:
    """Turns what the pages send into targets, requests and an emergency stop.

    Attributes:
        console: keys, claim to the robot, gait requests, emergency stop.
        pages: the open pages by number.
        page: number of the page that drives; None: none does.
        headset: whether its headset moves the hands; otherwise its keys and pointer do.
        late: messages that were held up on their way and did not count.
    """

    def __init__(self, config: HeadsetConfig) -> None:
        self._config = config
        self.console = Console(config.console)
        self.pages: dict[int, Page] = {}
        self.page: int | None = None
        self.headset = False
        self.late = 0
        self._drag: DragStart | None = None
        self._dragging = False
        self._silence_ns = round(1e9 * config.silence)

    def alive(self, now_ns: int) -> bool:
        """Return whether a page drives and is heard."""
        page = self._driving
        return page is not None and now_ns - page.heard_ns <= self._silence_ns

    def watched(self, now_ns: int) -> bool:
        """Return whether any page is heard, so that its person could press the stop."""
        return any(now_ns - page.heard_ns <= self._silence_ns for page in self.pages.values())

    def handle(self, event: Event, moment: Moment) -> list[Output]:
        """Take in what a page sent; return what that makes this operator send."""
        message = event.message
        if message is None or isinstance(message, Away):
            self._leave(event.page)
        if message is None:
            self.pages.pop(event.page, None)
            return []
        page = self.pages.setdefault(event.page, Page(HeadsetMapper(self._config.mapper)))
        page.echo = (message.t, event.arrival_ns)
        lateness = page.punctuality.lateness(message.t, event.arrival_ns)
        if isinstance(message, Key) and binding_of(message.key) is STOP:
            # Everybody's, and never too late.
            return self.console.press(message.key, moment.now, moment.stamp)
        if isinstance(message, Away):
            # A device that sleeps may stop the page's clock.
            page.punctuality = Punctuality()
            return []
        if lateness > self._config.silence:
            self.late += 1
            return []
        page.heard_ns = event.arrival_ns
        return self._act(event.page, message, moment)

    def _act(self, number: int, message: Incoming, moment: Moment) -> list[Output]:
        """Do what a page in time asks for."""
        match message:
            case Key():
                return self._key(number, message.key, moment)
            case Drag():
                self._follow_drag(number, message, moment)
            case Sample():
                return self._sample(number, message, moment)
            case Shown():
                page = self.pages[number]
                page.seen = moment.shown.get(message.picture, page.seen)
        return []

    def advance(self, dt: float, now: float) -> None:
        """Move what moves by itself for ``dt`` [s]; ``now`` is the operator's time [s]."""
        for page in self.pages.values():
            if not page.fresh:
                page.mapper.update(None, now)
            page.fresh = False
        if not self.alive(round(1e9 * now)):
            self._rest()
        self.console.targets.advance(dt)

    def start_from(self, target: Setpoint) -> None:
        """Have the headset start from the controller's present target."""
        if (page := self._driving) is not None:
            page.mapper.adopt(target)

    def setpoint(self, stamp: int) -> Setpoint:
        """Return the set-point; ``stamp`` is the robot time of what the operator saw [ns]."""
        page = self._driving
        if self.headset and page is not None:
            return page.mapper.setpoint(stamp)
        return self.console.targets.setpoint(stamp)

    @property
    def _driving(self) -> Page | None:
        return None if self.page is None else self.pages.get(self.page)

    def _leave(self, number: int) -> None:
        """Drive no longer, because the page has gone or nobody looks at it."""
        if self.page == number:
            self._use_console()
            self._rest()
            self.page = None

    def _rest(self) -> None:
        """End every motion where it is."""
        self._drag, self._dragging = None, False
        for hand in self.console.targets.hands.values():
            hand.place(Pose(hand.position, hand.quaternion))

    def _sits(self, number: int, name: str) -> bool:
        """Return whether a page may act: it drives, or nobody does and it does from now on."""
        if self.page != number:
            if self.page is not None and self.console.claimant.wants:
                self._refuse(number, f"{name}: not sent, another page drives; Enter takes over")
                return False
            self._sit(number)
        self.pages[number].notice = ""
        return True

    def _sit(self, number: int) -> None:
        if self.page is not None:
            self._leave(self.page)
        self.page = number

    def _refuse(self, number: int, notice: str) -> None:
        self.pages[number].notice = notice
        self.pages[number].refusals += 1

    def _key(self, number: int, key: str, moment: Moment) -> list[Output]:
        binding = binding_of(key)
        if binding is BY_KEY["Esc"]:
            self._refuse(number, "close the page to leave; the operator goes on for other pages")
            return []
        if binding is TAKE and self.page not in (None, number) and self.console.claimant.wants:
            self._sit(number)
            self.console.notice = "this page drives now; Enter gives the robot back"
            return []
        if not self._sits(number, key if binding is None else binding.help):
            return []
        if binding is not None and not isinstance(binding.command, RequestGait | SelectHands):
            self._use_console()
        return self._press(number, key, moment)

    def _press(self, number: int, key: str, moment: Moment) -> list[Output]:
        """Press a key of the console; count it as refused if it asks for the robot in vain."""
        before = self.console.notice
        outputs = self.console.press(key, moment.now, moment.stamp)
        if ": not sent" in self.console.notice and self.console.notice != before:
            self.pages[number].refusals += 1
        return outputs

    def _use_console(self) -> None:
        if self.headset and (page := self._driving) is not None:
            self.console.targets.adopt(page.mapper.setpoint())
        self.headset = False

    def _follow_drag(self, number: int, drag: Drag, moment: Moment) -> None:
        if drag.begins:
            self._drag, self._dragging = None, self._sits(number, "drag a hand")
            if self._dragging:
                self._use_console()
                self._ask(number, "drag a hand", moment)
        if not self._dragging or self.page != number or not self.console.claimant.has_robot:
            return
        way = np.array([drag.across, drag.down, drag.ahead])
        hand = self.console.targets.hands[drag.side]
        if self._drag is None or self._drag.side != drag.side:
            self._drag = DragStart(drag.side, hand.goal_position, moment.neck, way)
        hand.go_to(Pose(self._drag.goal(way), hand.goal_quaternion))

    def _ask(self, number: int, name: str, moment: Moment) -> None:
        if not self.console.claimant.has_robot and not self.console.ask_for(name, moment.now):
            self.pages[number].refusals += 1

    def _sample(self, number: int, sample: Sample, moment: Moment) -> list[Output]:
        page = self.pages[number]
        device = sample.device_input(page.saw(moment.stamp))
        before, page.device, page.fresh = page.device, device, True
        if stops(before, device):
            stop = self.console.press("x", moment.now, moment.stamp)
            page.mapper.update(device, moment.now)
            return stop
        clutch = engages(before, device, self._config.mapper.engage)
        pressed = any(goes_down(before, device, (button,)) for button in Button)
        if (clutch or pressed) and self._sits(number, "clutch" if clutch else "button"):
            self._use_headset(page)
            if clutch:
                self._ask(number, "clutch", moment)
        gaits = page.mapper.update(device, moment.now)
        if self.page != number:
            return []
        outputs = [Output(TELEOP_DEVICE, device)]
        claimant = self.console.claimant
        wanted = not claimant.has_robot and claimant.asked is None
        if page.taking.update(device if wanted else None, moment.now):
            outputs += self._press(number, "Enter", moment)
        for request in gaits:
            outputs += self._press(number, GAIT_KEYS[request.gait], moment)
        return outputs

    def _use_headset(self, page: Page) -> None:
        if not self.headset:
            page.mapper.adopt(self.console.targets.setpoint(0))
        self.headset = True

    def reply(self, number: int, now_ns: int) -> dict[str, Any]:
        """Return what only one page is told."""
        page = self.pages[number]
        told: dict[str, Any] = {
            "drives": self.page == number,
            "notice": page.notice,
            "refusals": page.refusals,
        }
        if page.echo is not None:
            sent_ms, arrival_ns = page.echo
            told["echo"] = {"t": sent_ms, "held": round(1e-6 * (now_ns - arrival_ns), 2)}
        return told
