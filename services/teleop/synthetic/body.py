"""The operator's own body and senses: hands with controllers, a head, time, and what varies.

Acts are generators that yield once a tick.
"""

from collections import deque
from collections.abc import Callable, Generator

import numpy as np

from common.robot.rotations import quaternion_from_rpy
from common.schemas import DeviceInput, Header
from services.teleop.errors import TeleopError
from services.teleop.headset.mapping import Button
from services.teleop.synthetic.limb import Limb, Tremor
from services.teleop.synthetic.sight import Sight
from services.teleop.synthetic.traits import OperatorTraits
from services.teleop.targets.hand import SIDES

Act = Generator[None, None, bool]
"""An act under way; returns whether it worked out."""
Sign = Callable[[Sight], bool]
"""Something to be seen."""

_GLANCE = 4
"""Pictures over which a hand's speed is judged."""


class StrategyError(TeleopError):
    """A plan has come to nothing; the message says where."""


class Body:
    """What moves and senses.

    Attributes:
        traits: what kind of operator.
        rng: of everything that varies.
        time: since the start [s].
        dt: since the last tick [s].
        sight: what is seen.
        limbs: own hands, by side.
        gaze: pitch of the head, positive looks down [rad].
        facing: heading in the own room [rad].
        button: held down; None: none.
        note: what it is doing.
    """

    def __init__(self, traits: OperatorTraits, rng: np.random.Generator, sight: Sight) -> None:
        self.traits, self.rng = traits, rng
        self.time, self.dt = 0.0, 0.05
        self.sight = sight
        self.limbs = {s: Limb(s, rng, traits.tremor, traits.tremor_angle) for s in SIDES}
        self.gaze = 0.3
        self.note = ""
        self.facing = float(rng.uniform(-np.pi, np.pi))
        self.button: Button | None = None
        self._head_sway = Tremor(rng, traits.head_sway, 3)
        self._head_turn = Tremor(rng, traits.head_turn, 3)
        self._head_pitch = self.gaze
        self._speed = dict.fromkeys(SIDES, 0.0)
        self._past: deque[Sight] = deque(maxlen=_GLANCE)

    def look(self, sight: Sight, time: float, dt: float) -> None:
        """Take in one picture."""
        if sight.stamp > self.sight.stamp:
            self._past.append(self.sight)
            then = self._past[0]
            elapsed = (sight.stamp - then.stamp) * 1e-9
            for side in SIDES:
                moved = sight.hands[side].position - then.hands[side].position
                self._speed[side] = float(np.linalg.norm(moved)) / elapsed
        self.sight, self.time, self.dt = sight, time, dt

    def hand_speed(self, side: str) -> float:
        """How fast a hand of the robot is seen to move [m/s]."""
        return self._speed[side]

    def advance(self, dt: float) -> None:
        """Let both hands and the head move on for ``dt`` [s]."""
        for limb in self.limbs.values():
            limb.advance(dt)
        self._head_pitch += (self.gaze - self._head_pitch) * min(1.0, 3.0 * dt)

    def device(self) -> DeviceInput:
        """What the headset and the controllers report now."""
        time = self.time
        roll, pitch, yaw = self._head_turn.at(time).tolist()
        limbs = {s: limb.controller(time, self.facing) for s, limb in self.limbs.items()}
        if self.button is not None:
            side, name = self.button.value
            limbs[side] = limbs[side].model_copy(update={name: True})
        return DeviceInput(
            header=Header(stamp=self.sight.stamp),
            device="synthetic",
            head_position=np.array([0.0, 0.0, 1.65]) + self._head_sway.at(time),
            head_quaternion=quaternion_from_rpy(roll, self._head_pitch + pitch, self.facing + yaw),
            head_tracked=True,
            left=limbs["left"],
            right=limbs["right"],
        )

    def vary(self, value: float, spread: float) -> float:
        """``value`` with a deviation of ``spread``, at most twice that."""
        draw = float(np.clip(self.rng.normal(), -2.0, 2.0))
        return value + self.traits.variety * spread * draw

    def chance(self, probability: float) -> bool:
        """Whether it feels like it this time."""
        return float(self.rng.uniform()) < probability * min(1.0, self.traits.variety)

    def pause(self, seconds: float) -> Act:
        """Do nothing for a while."""
        until = self.time + seconds
        while self.time < until:
            yield
        return True

    def react(self) -> Act:
        """Take the time a person takes from seeing to acting."""
        spread = self.traits.reaction_spread * float(self.rng.normal())
        yield from self.pause(self.traits.reaction * float(np.exp(spread)))
        return True

    def wait_until(self, sign: Sign, longest: float) -> Act:
        """Wait until something is seen; False if it is not within ``longest`` [s]."""
        until = self.time + longest
        while not sign(self.sight):
            if self.time >= until:
                return False
            yield
        return True

    def together(self, *acts: Act) -> Act:
        """Several acts at once; True if all worked out."""
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
