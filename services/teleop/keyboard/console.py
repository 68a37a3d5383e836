"""What the keyboard operator remembers and does for each key; pure, without a terminal."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from common.runtime.service import Output
from common.schemas import (
    Estop,
    Gait,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    Header,
    PlantAction,
    PlantRequest,
)
from common.schemas.arrays import Float64Array as Array
from common.topics import ESTOP, PLANT_REQUEST, TELEOP_GAIT
from services.teleop.keyboard.keymap import (
    BY_KEY,
    Axis,
    Command,
    Do,
    Look,
    Select,
    Shift,
    Turn,
    Walk,
)
from services.teleop.targets.hand import SIDES, MotionLimits, home_pose
from services.teleop.targets.targets import OperatorTargets

GAITS_SHOWN = 3
ANSWER_EXPECTED = 2.0
"""A gait request without an answer for this long is shown as unanswered [s]."""


class KeyboardConfig(BaseModel):
    """Step sizes of the keys and speeds of the targets."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    limits: MotionLimits = MotionLimits()
    distance_step: float = Field(default=0.02, gt=0.0, description="hand [m]")
    angle_step: float = Field(default=math.radians(5.0), gt=0.0, description="hand, neck [rad]")
    repeat_window: float = Field(default=1.0, gt=0.0, description="for keys pressed twice [s]")
    push_force: float = Field(default=80.0, gt=0.0, description="on the torso, forward [N]")
    push_duration: float = Field(default=0.1, gt=0.0, le=5.0, description="[s]")


@dataclass(frozen=True)
class Asked:
    """One gait request and what is known of it.

    ``outcome`` is None before any answer; ``since`` is the operator's time [s] of the last news.
    """

    request_id: int
    gait: Gait
    since: float
    outcome: GaitOutcome | None = None
    reason: str = ""

    def describe(self, now: float) -> str:
        """One line for the screen; ``now`` is the operator's time [s]."""
        name = self.gait.name.lower().replace("_", " ")
        if self.outcome is None:
            waited = now - self.since
            silent = waited > ANSWER_EXPECTED
            return f"{name}: {f'NO ANSWER for {waited:.0f} s' if silent else 'asked'}"
        if self.outcome in {GaitOutcome.REFUSED, GaitOutcome.ABORTED}:
            return f"{name}: {self.outcome.name} - {self.reason or 'no reason given'}"
        return f"{name}: {self.outcome.name.lower()}"


@dataclass
class Console:
    """The keyboard operator's state.

    Attributes:
        config: step sizes.
        targets: hands, grippers, neck.
        next_id: id of the next gait request.
        selected: sides that the hand keys move.
        asked: the last gait requests, oldest first.
        notice: last thing to tell the person.
        watching: why commands to the robot are held back; empty when they are not.
        paused: whether the plant says that it is paused.
        quit: the person wants to leave.
    """

    config: KeyboardConfig = field(default_factory=KeyboardConfig)
    targets: OperatorTargets = field(init=False)
    next_id: int = 0
    selected: tuple[str, ...] = ("left",)
    asked: deque[Asked] = field(default_factory=lambda: deque(maxlen=GAITS_SHOWN))
    notice: str = ""
    watching: str = ""
    paused: bool = False
    quit: bool = False
    _pressed: tuple[str, float] = ("", -math.inf)

    def __post_init__(self) -> None:
        self.targets = OperatorTargets(self.config.limits)
        self._home(SIDES)

    def press(self, key: str, now: float, stamp: int) -> list[Output]:
        """Act on a key pressed at the operator's time ``now`` [s].

        ``stamp`` is the last known robot time [ns], for what is sent.
        """
        binding = BY_KEY.get(key)
        if binding is None:
            self.notice = f"{key!r} does nothing; the keys are listed below"
            return []
        if binding.twice:
            before, self._pressed = self._pressed, (key, now)
            if before[0] != key or now - before[1] > self.config.repeat_window:
                self.notice = f"press {key} once more to {binding.help}"
                return []
        self._pressed = ("", -math.inf)
        command = binding.command
        if self.watching and _moves_robot(command):
            self.notice = f"{binding.help}: not sent, {self.watching}"
            return []
        self.notice = binding.help
        return self._act(command, now, Header(stamp=stamp))

    def hear(self, replies: Iterable[GaitReply], now: float) -> None:
        """Match replies with requests; those to other operators are left alone."""
        for reply in replies:
            for index, asked in enumerate(self.asked):
                if asked.request_id == reply.request_id:
                    self.asked[index] = replace(
                        asked, outcome=reply.outcome, reason=reply.reason, since=now
                    )
                    if reply.outcome in {GaitOutcome.REFUSED, GaitOutcome.ABORTED}:
                        self.notice = f"{reply.outcome.name.lower()}: {reply.reason}"

    def _act(self, command: Command, now: float, header: Header) -> list[Output]:
        match command:
            case Walk(gait):
                request = GaitRequest(header=header, request_id=self.next_id, gait=gait)
                self.next_id += 1
                self.asked.append(Asked(request.request_id, gait, now))
                return [Output(TELEOP_GAIT, request)]
            case Select(sides):
                self.selected = sides
            case Shift(axis, sign):
                self._each(lambda side: self._shift(side, axis, sign))
            case Turn(axis, sign):
                self._each(lambda side: self._turn(side, axis, sign))
            case Look(sign):
                self.targets.look(self.targets.goal_neck + sign * self.config.angle_step)
            case Do():
                return self._do(command, header)
        return []

    def _do(self, command: Do, header: Header) -> list[Output]:
        match command.what:
            case "grip":
                self._grip()
            case "home":
                self._home(self.selected)
            case "push":
                return [Output(PLANT_REQUEST, self._push(header))]
            case "pause":
                action = PlantAction.RESUME if self.paused else PlantAction.PAUSE
                self.notice = f"{action.name.lower()} the plant"
                return [Output(PLANT_REQUEST, PlantRequest(header=header, action=action))]
            case "reset":
                request = PlantRequest(header=header, action=PlantAction.RESET)
                return [Output(PLANT_REQUEST, request)]
            case "estop":
                return [Output(ESTOP, Estop(header=header, reason="keyboard operator"))]
            case "quit":
                self.quit = True
        return []

    def _each(self, act: Callable[[str], None]) -> None:
        for side in self.selected:
            act(side)

    def _shift(self, side: str, axis: Axis, sign: int) -> None:
        self.targets.hands[side].shift(_along(axis, sign * self.config.distance_step))

    def _turn(self, side: str, axis: Axis, sign: int) -> None:
        self.targets.hands[side].turn(_along(axis, sign * self.config.angle_step))

    def _grip(self) -> None:
        """Close the selected grippers, or open them if all of them are closing or closed."""
        goals = [self.targets.goal_closure[SIDES.index(side)] for side in self.selected]
        closure = 0.0 if all(goal > 0.5 for goal in goals) else 1.0
        for side in self.selected:
            self.targets.grip(side, closure)
        self.notice = "grip" if closure else "release"

    def _home(self, sides: Sequence[str]) -> None:
        for side in sides:
            self.targets.hands[side].go_to(home_pose(side))

    def _push(self, header: Header) -> PlantRequest:
        return PlantRequest(
            header=header,
            action=PlantAction.PUSH,
            force=np.array([self.config.push_force, 0.0, 0.0]),
            duration=self.config.push_duration,
        )


def _moves_robot(command: Command) -> bool:
    """Whether a command competes with another operator's; stopping the robot never does."""
    if isinstance(command, Do):
        return command.what in {"grip", "home"}
    return not isinstance(command, Select)


def _along(axis: Axis, length: float) -> Array:
    vector = np.zeros(3)
    vector["xyz".index(axis)] = length
    return vector
