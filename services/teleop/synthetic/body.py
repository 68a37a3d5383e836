"""Body and senses of the synthetic operator: hand controllers, head, time and random variation.

Acts are generators that yield once a tick and return whether they succeeded.
"""

from collections import deque
from collections.abc import Callable, Generator

import numpy as np

from common.robot.rotations import quaternion_from_rpy
from common.schemas import DeviceInput, Header
from services.teleop.errors import TeleopError
from services.teleop.headset.mapping import Button
from services.teleop.synthetic.observation import Observation
from services.teleop.synthetic.operator_hand import OperatorHand, Slips, Tremor
from services.teleop.synthetic.traits import OperatorTraits
from services.teleop.targets.hand import SIDES

Act = Generator[None, None, bool]
"""An act in progress; its value is whether it succeeded."""
Condition = Callable[[Observation], bool]
"""A condition on what is observed."""

_SPEED_WINDOW = 4
"""Observations over which a hand's speed is estimated."""


class StrategyError(TeleopError):
    """The operator cannot complete its plan; the message says where it failed."""


class OperatorBody:
    """Moves hands and head, and observes robot and scene.

    Attributes:
        traits: parameters of the operator.
        rng: of all random variation.
        time: since the start [s].
        dt: since the last tick [s].
        seen: last observation.
        own_hands: the operator's hands by side.
        gaze: pitch of the head, positive looks down [rad].
        facing: heading in the operator's room [rad].
        button: button that is held down; None: none.
        note: what the operator is doing.
    """

    def __init__(self, traits: OperatorTraits, rng: np.random.Generator, seen: Observation) -> None:
        self.traits, self.rng = traits, rng
        self.time, self.dt = 0.0, 0.05
        self.seen = seen
        self.own_hands = {
            s: OperatorHand(
                s,
                rng,
                traits.tremor,
                traits.tremor_angle,
                Slips(rng, traits.slips, traits.slip, traits.slip_angle),
            )
            for s in SIDES
        }
        self.gaze = 0.3
        self.note = ""
        self.facing = float(rng.uniform(-np.pi, np.pi))
        self.button: Button | None = None
        self._head_sway = Tremor(rng, traits.head_sway, 3)
        self._head_turn = Tremor(rng, traits.head_turn, 3)
        self._head_pitch = self.gaze
        self._speed = dict.fromkeys(SIDES, 0.0)
        self._past: deque[Observation] = deque(maxlen=_SPEED_WINDOW)

    def observe(self, seen: Observation, time: float, dt: float) -> None:
        """Take in an observation and estimate the speeds of the robot's hands from it."""
        if seen.stamp > self.seen.stamp:
            self._past.append(self.seen)
            then = self._past[0]
            elapsed = (seen.stamp - then.stamp) * 1e-9
            for side in SIDES:
                moved = seen.hands[side].position - then.hands[side].position
                self._speed[side] = float(np.linalg.norm(moved)) / elapsed
        self.seen, self.time, self.dt = seen, time, dt

    def hand_speed(self, side: str) -> float:
        """Return the observed speed of a hand of the robot [m/s]."""
        return self._speed[side]

    @property
    def slipping(self) -> bool:
        """Whether a hand is being knocked off its way."""
        return any(own.slips.away for own in self.own_hands.values())

    def advance(self, dt: float) -> None:
        """Advance hands and head by ``dt`` [s]."""
        for own in self.own_hands.values():
            own.advance(dt)
        self._head_pitch += (self.gaze - self._head_pitch) * min(1.0, 3.0 * dt)

    def device(self) -> DeviceInput:
        """Return the sample that headset and controllers report now."""
        time = self.time
        roll, pitch, yaw = self._head_turn.at(time).tolist()
        samples = {s: own.controller(time, self.facing) for s, own in self.own_hands.items()}
        if self.button is not None:
            side, name = self.button.value
            samples[side] = samples[side].model_copy(update={name: True})
        return DeviceInput(
            header=Header(stamp=self.seen.stamp),
            device="synthetic",
            head_position=np.array([0.0, 0.0, 1.65]) + self._head_sway.at(time),
            head_quaternion=quaternion_from_rpy(roll, self._head_pitch + pitch, self.facing + yaw),
            head_tracked=True,
            left=samples["left"],
            right=samples["right"],
        )

    def vary(self, value: float, spread: float) -> float:
        """Return ``value`` plus a normal variate of deviation ``spread``, cut off at twice that."""
        draw = float(np.clip(self.rng.normal(), -2.0, 2.0))
        return value + self.traits.variety * spread * draw

    def chance(self, probability: float) -> bool:
        """Return True with this probability."""
        return float(self.rng.uniform()) < probability * min(1.0, self.traits.variety)

    def pause(self, seconds: float) -> Act:
        """Do nothing for a while [s]."""
        until = self.time + seconds
        while self.time < until:
            yield
        return True

    def react(self) -> Act:
        """Wait for a reaction time, drawn from the operator's distribution."""
        spread = self.traits.reaction_spread * float(self.rng.normal())
        yield from self.pause(self.traits.reaction * float(np.exp(spread)))
        return True

    def wait_until(self, condition: Condition, longest: float) -> Act:
        """Wait for a condition; fails if it is not met within ``longest`` [s]."""
        until = self.time + longest
        while not condition(self.seen):
            if self.time >= until:
                return False
            yield
        return True

    def together(self, *acts: Act) -> Act:
        """Do several acts at once; succeeds if all of them do."""
        running, fine = list(acts), True
        while running:
            for act in list(running):
                try:
                    next(act)
                except StopIteration as stop:
                    running.remove(act)
                    fine = fine and bool(stop.value)
            if running:
                yield
        return fine
