"""State of the keyboard operator and the effect of each key; pure, without a terminal."""

import math
from collections import deque
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from common.estop import StopButton
from common.operator.claim import Claimant
from common.runtime.service import Output
from common.schemas import (
    EstopClear,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    GuardMode,
    Header,
    OperatorKind,
    PlantAction,
    PlantRequest,
    PlantStatus,
    Setpoint,
)
from common.schemas.arrays import Float64Array as Array
from common.topics import ESTOP_CLEAR, PLANT_REQUEST, TELEOP_GAIT
from services.teleop.keyboard.config import KeyboardConfig
from services.teleop.keyboard.keymap import (
    Action,
    Axis,
    Binding,
    Command,
    MoveHands,
    PitchHead,
    RequestGait,
    SelectHands,
    TurnHands,
    binding_of,
)
from services.teleop.keyboard.requests import SentRequest
from services.teleop.targets.hand import SIDES, home_pose
from services.teleop.targets.targets import OperatorTargets

GAITS_SHOWN = 3
KEYS_KEPT = 8
"""Largest number of keys that wait for the robot."""


@dataclass
class Console:
    """State of the keyboard operator.

    Keys that move the robot count only while this operator has it. Pressed while nobody has it,
    they ask for it, and take effect when the controller grants it.

    Attributes:
        config: step sizes.
        targets: hands, grippers, neck.
        claimant: claim to the robot.
        button: emergency stop.
        plant: last status of the plant, if it is fresh.
        next_id: id of the next gait request.
        selected: sides of the hands that the keys move.
        requests: the last gait requests, oldest first.
        notice: last message to the person.
        quit: whether the person wants to quit.
    """

    config: KeyboardConfig = field(default_factory=KeyboardConfig)
    targets: OperatorTargets = field(init=False)
    claimant: Claimant = field(default_factory=lambda: Claimant(OperatorKind.PERSON))
    button: StopButton = field(default_factory=StopButton)
    plant: PlantStatus | None = None
    next_id: int = 0
    selected: tuple[str, ...] = ("left",)
    requests: deque[SentRequest] = field(default_factory=lambda: deque(maxlen=GAITS_SHOWN))
    notice: str = ""
    quit: bool = False
    _pressed: tuple[Binding | None, float] = (None, -math.inf)
    _waiting: deque[Command] = field(default_factory=lambda: deque(maxlen=KEYS_KEPT))
    _had_robot: bool = False
    _controller: int = 0

    def __post_init__(self) -> None:
        self.targets = OperatorTargets(self.config.limits)

    @property
    def stopped(self) -> bool:
        """Whether the plant is seen to be stopped."""
        return self.plant is not None and self.plant.guard is GuardMode.ESTOP

    def press(self, key: str, now: float, stamp: int) -> list[Output]:
        """Return the messages to send for a key; the emergency stop's come from the button.

        Args:
            key: name of the key.
            now: operator's time [s].
            stamp: last known robot time [ns].
        """
        binding = binding_of(key)
        if binding is None:
            foreign = "" if key.isascii() else "; Backspace and Delete stop in every layout"
            self.notice = f"{key!r} does nothing{foreign}; the keys are listed below"
            return []
        if binding.twice:
            before, self._pressed = self._pressed, (binding, now)
            if before[0] is not binding or now - before[1] > self.config.repeat_window:
                self.notice = f"press {binding.keys[0]} once more to {binding.help}"
                return []
        self._pressed = (None, -math.inf)
        command = binding.command
        if _moves_robot(command) and not self.claimant.has_robot:
            self.ask_for(binding.help, now, command)
            return []
        self.notice = binding.help
        return self._act(command, now, Header(stamp=stamp))

    def follow(self, target: Setpoint | None, now: float, stamp: int) -> list[Output]:
        """Take in whether it has the robot; return what keys that waited for it send.

        Args:
            target: present target of the controller, from which this operator starts.
            now: operator's time [s].
            stamp: last known robot time [ns].
        """
        has, had = self.claimant.has_robot, self._had_robot
        self._had_robot = has
        if not had and target is not None:
            self.targets.adopt(target)
        if has == had:
            if self.claimant.give_up(now):
                self._waiting.clear()
                self.notice = f"not given to you: {self.claimant.waits_for()}; Enter asks again"
            return []
        if not has:
            self._waiting.clear()
            self.notice = (
                "the stop took the robot from you; after its end Enter takes it anew"
                if self.stopped
                else f"you no longer have it: {self.claimant.waits_for()}"
            )
            return []
        self.notice = "you have the robot; Enter gives it back"
        commands = list(self._waiting)
        self._waiting.clear()
        return [output for each in commands for output in self._act(each, now, Header(stamp=stamp))]

    def ask_for(self, name: str, now: float, command: Command | None = None) -> bool:
        """Ask for the robot for an act of the person, if that takes it from nobody; say so.

        Args:
            name: of the act.
            now: operator's time [s].
            command: carried out when the robot is granted; None: nothing is.

        Returns:
            whether the robot was asked for.
        """
        claimant = self.claimant
        if self.stopped:
            why = "the robot is stopped; b b ends the stop"
        elif claimant.asked is None and claimant.authority is None:
            why = claimant.waits_for()
        elif claimant.asked is None and claimant.holder:
            why = f"{claimant.holder} has the robot; Enter takes it"
        else:
            if claimant.asked is None:
                claimant.ask(now)
            if command is not None:
                self._waiting.append(command)
            self.notice = f"{name}: asking for the robot"
            return True
        self.notice = f"{name}: not sent, {why}"
        return False

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

    def note_controller(self, boot: int, now: float) -> None:
        """End the gaits that an earlier controller than the one with this boot id began."""
        before, self._controller = self._controller, boot or self._controller
        if before in (0, self._controller):
            return
        for index, sent in enumerate(self.requests):
            if sent.outcome is GaitOutcome.ACCEPTED:
                self.requests[index] = replace(
                    sent,
                    outcome=GaitOutcome.ABORTED,
                    reason="the controller was restarted",
                    since=now,
                )

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
                return self._run(command, now, header)
        return []

    def _run(self, command: Action, now: float, header: Header) -> list[Output]:
        match command.name:
            case "grip":
                self._grip()
            case "home":
                self._home(self.selected)
            case "push":
                return [Output(PLANT_REQUEST, self._push(header))]
            case "pause":
                paused = self.plant is not None and self.plant.paused
                action = PlantAction.RESUME if paused else PlantAction.PAUSE
                self.notice = f"{action.name.lower()} the plant"
                return [Output(PLANT_REQUEST, PlantRequest(header=header, action=action))]
            case "reset":
                self.notice = "reset the plant" + "; it stays stopped" * self.stopped
                request = PlantRequest(header=header, action=PlantAction.RESET)
                return [Output(PLANT_REQUEST, request)]
            case "estop":
                self.button.press("a person pressed the key", round(now * 1e9))
            case "clear":
                return self._clear(header)
            case "take":
                self._take_or_give(now)
            case "quit":
                self.quit = True
        return []

    def _take_or_give(self, now: float) -> None:
        if self.claimant.has_robot:
            self.claimant.release()
            self._had_robot = False
            self.notice = "given back: whoever waits goes on"
        elif self.stopped:
            self.notice = "nobody has a stopped robot; b b ends the stop, then Enter takes it"
        else:
            self.claimant.ask(now)
            self.notice = "asking for the robot"

    def _clear(self, header: Header) -> list[Output]:
        if self.plant is None or not self.stopped:
            self.notice = "no stop to end, as far as the plant was heard"
            return []
        self.notice = "ending the stop; then Enter takes the robot"
        clear = EstopClear(header=header, reason="a person at the keyboard", stops=self.plant.stops)
        return [Output(ESTOP_CLEAR, clear)]

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
