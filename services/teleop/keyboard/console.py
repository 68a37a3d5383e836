"""State of the keyboard operator and the effect of each key; pure, without a terminal."""

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
    Action,
    Axis,
    Command,
    MoveHands,
    PitchHead,
    RequestGait,
    SelectHands,
    TurnHands,
)
from services.teleop.targets.hand import SIDES, MotionLimits, home_pose
from services.teleop.targets.targets import OperatorTargets

GAITS_SHOWN = 3
ANSWER_EXPECTED = 2.0
"""Time after which a gait request is shown as unanswered [s]."""


class KeyboardConfig(BaseModel):
    """Step sizes of the keys and speeds of the targets."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    limits: MotionLimits = MotionLimits()
    distance_step: float = Field(default=0.02, gt=0.0, description="step of a hand [m]")
    angle_step: float = Field(
        default=math.radians(5.0), gt=0.0, description="step of a hand or the neck [rad]"
    )
    repeat_window: float = Field(
        default=1.0, gt=0.0, description="between two presses of a key that needs both [s]"
    )
    push_force: float = Field(
        default=80.0, gt=0.0, description="force of a push on the torso, forward [N]"
    )
    push_duration: float = Field(default=0.1, gt=0.0, le=5.0, description="[s]")


@dataclass(frozen=True)
class SentRequest:
    """A gait request and its latest answer.

    Attributes:
        request_id: of the request.
        gait: requested.
        since: operator's time of the last change [s].
        outcome: None before any answer.
        reason: of a refusal or abortion.
    """

    request_id: int
    gait: Gait
    since: float
    outcome: GaitOutcome | None = None
    reason: str = ""

    def describe(self, now: float) -> str:
        """Return one line for the screen; ``now`` is the operator's time [s]."""
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
    """State of the keyboard operator.

    Attributes:
        config: step sizes.
        targets: hands, grippers, neck.
        next_id: id of the next gait request.
        selected: sides of the hands that the keys move.
        requests: the last gait requests, oldest first.
        notice: last message to the person.
        watching: reason for which commands to the robot are held back; empty: they are not.
        paused: whether the plant is paused.
        quit: whether the person wants to quit.
    """

    config: KeyboardConfig = field(default_factory=KeyboardConfig)
    targets: OperatorTargets = field(init=False)
    next_id: int = 0
    selected: tuple[str, ...] = ("left",)
    requests: deque[SentRequest] = field(default_factory=lambda: deque(maxlen=GAITS_SHOWN))
    notice: str = ""
    watching: str = ""
    paused: bool = False
    quit: bool = False
    _pressed: tuple[str, float] = ("", -math.inf)

    def __post_init__(self) -> None:
        self.targets = OperatorTargets(self.config.limits)
        self._home(SIDES)

    def press(self, key: str, now: float, stamp: int) -> list[Output]:
        """Return the messages to send for a key.

        Args:
            key: name of the key.
            now: operator's time [s].
            stamp: last known robot time [ns].
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

    def update_requests(self, replies: Iterable[GaitReply], now: float) -> None:
        """Update the sent requests with replies; replies to other operators are ignored."""
        for reply in replies:
            for index, sent in enumerate(self.requests):
                if sent.request_id == reply.request_id:
                    self.requests[index] = replace(
                        sent, outcome=reply.outcome, reason=reply.reason, since=now
                    )
                    if reply.outcome in {GaitOutcome.REFUSED, GaitOutcome.ABORTED}:
                        self.notice = f"{reply.outcome.name.lower()}: {reply.reason}"

    def _act(self, command: Command, now: float, header: Header) -> list[Output]:
        match command:
            case RequestGait(gait):
                request = GaitRequest(header=header, request_id=self.next_id, gait=gait)
                self.next_id += 1
                self.requests.append(SentRequest(request.request_id, gait, now))
                return [Output(TELEOP_GAIT, request)]
            case SelectHands(sides):
                self.selected = sides
            case MoveHands(axis, sign):
                self._for_selected(lambda side: self._shift(side, axis, sign))
            case TurnHands(axis, sign):
                self._for_selected(lambda side: self._turn(side, axis, sign))
            case PitchHead(sign):
                self.targets.look(self.targets.goal_neck + sign * self.config.angle_step)
            case Action():
                return self._run(command, header)
        return []

    def _run(self, command: Action, header: Header) -> list[Output]:
        match command.name:
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

    def _for_selected(self, act: Callable[[str], None]) -> None:
        for side in self.selected:
            act(side)

    def _shift(self, side: str, axis: Axis, sign: int) -> None:
        self.targets.hands[side].shift(_along(axis, sign * self.config.distance_step))

    def _turn(self, side: str, axis: Axis, sign: int) -> None:
        self.targets.hands[side].turn(_along(axis, sign * self.config.angle_step))

    def _grip(self) -> None:
        """Close the selected grippers, or open them if all are closed or closing."""
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
    """Return whether a command moves the robot and so competes with another operator."""
    if isinstance(command, Action):
        return command.name in {"grip", "home"}
    return not isinstance(command, SelectHands)


def _along(axis: Axis, length: float) -> Array:
    vector = np.zeros(3)
    vector["xyz".index(axis)] = length
    return vector
