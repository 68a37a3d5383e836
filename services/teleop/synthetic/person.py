"""The acting part of the synthetic operator: reaches, presses, waits and asks for gaits.

Acts are generators that yield once a tick. The operator knows its own hands without delay and the
robot's only from what it sees: a hand is expected where it was last seen at rest plus what the
own hand has moved since. After each reach it waits until what it sees agrees, or until the robot's
hand has come to rest elsewhere, and then corrects: with a delayed picture it moves and waits, as
people do.
"""

from collections import deque
from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass

import numpy as np

from common.schemas import DeviceInput, Gait, GaitOutcome, GaitReply, Header
from services.teleop.errors import TeleopError
from services.teleop.hand import SIDES
from services.teleop.ingress import GAIT_BUTTONS, Button
from services.teleop.rotations import Array, from_rpy, multiply, rotate, rotation_vector
from services.teleop.synthetic.limb import Limb, Tremor
from services.teleop.synthetic.sight import Pose, Sight
from services.teleop.synthetic.traits import OperatorTraits

Act = Generator[None, None, bool]
"""An act under way; returns whether it worked out."""
Goal = Callable[[Sight], Pose]
"""Where a hand should be, in the body frame, by what is seen."""
Sign = Callable[[Sight], bool]
"""Something to be seen."""

_BUTTON_OF = {gait: button for button, gait in GAIT_BUTTONS.items()}
_ONSET = 0.025
"""A hand that has moved this far has visibly moved [m]."""
_CORRECTION = 0.05
"""A hand that does not get nearer is not sent ever further [m]."""
_GLANCE = 4
"""Pictures over which a hand's speed is judged."""
_LONGEST_WAIT = 6.0
_STEER = 1.0
"""How quickly a hand that strays from its line is brought back [1/s]."""
_RAMP = 0.3
"""Time in which a steady push gets up to speed [s]."""


class StrategyError(TeleopError):
    """A plan has come to nothing; the message says where."""


@dataclass
class _Anchor:
    """Where the robot's hand was seen at rest, and the own hand with it."""

    seen: Pose
    position: Array
    quaternion: Array


@dataclass
class _Onset:
    """A reach that has not been seen to begin: own and seen hand before it, when it was felt."""

    own: Array
    seen: Array
    felt: float | None = None


class Person:
    """One operator with two hands.

    Attributes:
        traits: what kind of operator.
        rng: of everything that varies.
        time: since the start [s].
        sight: what is seen.
        limbs: own hands, by side.
        lag: from an own movement until it is seen to begin, as experienced [s].
        gaze: pitch of the head, positive looks down [rad].
        note: what it is doing.
    """

    def __init__(self, traits: OperatorTraits, rng: np.random.Generator, sight: Sight) -> None:
        self.traits, self.rng = traits, rng
        self.time, self.dt = 0.0, 0.05
        self.sight = sight
        self.limbs = {s: Limb(s, rng, traits.tremor, traits.tremor_angle) for s in SIDES}
        self.lag = 0.1
        self.gaze = 0.3
        self.note = ""
        self.facing = float(rng.uniform(-np.pi, np.pi))
        self._head_sway = Tremor(rng, traits.head_sway, 3)
        self._head_turn = Tremor(rng, traits.head_turn, 3)
        self._head_pitch = self.gaze
        self._button: Button | None = None
        self._replies: list[GaitReply] = []
        self._anchors = {s: self._anchored(s) for s in SIDES}
        self._speed = dict.fromkeys(SIDES, 0.0)
        self._onsets: dict[str, _Onset] = {}
        self._past: deque[Sight] = deque(maxlen=_GLANCE)

    # What the world and the service see of it.

    def perceive(self, sight: Sight, replies: Sequence[GaitReply], time: float, dt: float) -> None:
        """Take in one picture and the replies that came with it."""
        if sight.stamp > self.sight.stamp:
            self._past.append(self.sight)
            then = self._past[0]
            elapsed = (sight.stamp - then.stamp) * 1e-9
            for side in SIDES:
                moved = sight.hands[side].position - then.hands[side].position
                self._speed[side] = float(np.linalg.norm(moved)) / elapsed
        self.sight, self.time, self.dt = sight, time, dt
        self._replies += replies
        for side in SIDES:
            self._feel_lag(side)

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
        if self._button is not None:
            side, name = self._button.value
            limbs[side] = limbs[side].model_copy(update={name: True})
        return DeviceInput(
            header=Header(stamp=self.sight.stamp),
            device="synthetic",
            head_position=np.array([0.0, 0.0, 1.65]) + self._head_sway.at(time),
            head_quaternion=from_rpy(roll, self._head_pitch + pitch, self.facing + yaw),
            head_tracked=True,
            left=limbs["left"],
            right=limbs["right"],
        )

    # Varying.

    def vary(self, value: float, spread: float) -> float:
        """``value`` with a deviation of ``spread``, at most twice that."""
        draw = float(np.clip(self.rng.normal(), -2.0, 2.0))
        return value + self.traits.variety * spread * draw

    def choose(self, *options: float) -> float:
        """One of several equally good options; without variety the first."""
        return options[int(self.rng.integers(len(options)))] if self.traits.variety else options[0]

    def chance(self, probability: float) -> bool:
        """Whether it feels like it this time."""
        return float(self.rng.uniform()) < probability * min(1.0, self.traits.variety)

    # Time.

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

    # Hands.

    def engage(self, *sides: str) -> Act:
        """Squeeze the clutches and look where the robot's hands are."""
        for side in sides:
            self.limbs[side].squeeze = 1.0
        yield from self.pause(2.0 * self.dt)
        for side in sides:
            self._anchors[side] = self._anchored(side)
        return True

    def expected(self, side: str) -> Pose:
        """Where the robot's hand should be by now, in the body frame."""
        anchor, limb = self._anchors[side], self.limbs[side]
        turn = rotation_vector(anchor.quaternion, limb.quaternion)
        return Pose(
            anchor.seen.position + limb.position - anchor.position,
            rotate(anchor.seen.quaternion, turn),
        )

    def reach(
        self,
        side: str,
        goal: Goal,
        *,
        speed: float = 1.0,
        tolerance: float = 0.02,
        angle: float = 0.15,
        corrections: int = 3,
        until: Sign | None = None,
        through: bool = False,
    ) -> Act:
        """Bring a hand to a goal, look, and correct.

        Args:
            side: ``left`` or ``right``.
            goal: where to, looked at again before each correction.
            speed: share of the operator's usual speed.
            tolerance: near enough [m].
            angle: turned near enough [rad].
            corrections: at most so many.
            until: ends the reach at once, after a reaction time.
            through: do not stop and look; the next reach goes on from here.

        Returns:
            whether the hand was seen near enough, or ``until``.
        """
        for attempt in range(1 + corrections):
            target = goal(self.sight)
            self._aim(side, target, speed, _CORRECTION if attempt else np.inf)
            ended = yield from self._watch(side, until)
            if ended or through:
                return True
            yield from self.settle(side)
            if until is not None and until(self.sight):
                return True
            seen, target = self.sight.hands[side], goal(self.sight)
            off = float(np.linalg.norm(target.position - seen.position))
            turned = float(np.linalg.norm(rotation_vector(seen.quaternion, target.quaternion)))
            if off < tolerance and turned < angle:
                return True
            if attempt < corrections:
                yield from self.react()
        return False

    def _aim(self, side: str, target: Pose, speed: float, longest: float) -> None:
        traits, limb, here = self.traits, self.limbs[side], self.expected(side)
        shift = target.position - here.position
        turn = rotation_vector(here.quaternion, target.quaternion)
        distance, angle = float(np.linalg.norm(shift)), float(np.linalg.norm(turn))
        if distance > longest:
            shift, distance = shift * (longest / distance), longest
        shift = shift + self.rng.normal(0.0, traits.aim_error * distance, 3)
        needed = max(distance / traits.reach_speed, angle / traits.turn_speed)
        duration = max(traits.shortest_reach, needed) / speed
        limb.move(shift, turn, duration)
        self._onsets[side] = _Onset(limb.position, self.sight.hands[side].position)

    def _watch(self, side: str, until: Sign | None) -> Act:
        """Let a reach go on to its end, or until something is seen."""
        limb = self.limbs[side]
        while limb.moving:
            yield
            if until is not None and until(self.sight):
                yield from self.react()
                limb.stop()
                return True
        return False

    def _feel_lag(self, side: str) -> None:
        """Learn the lag from when a reach is felt and when it is seen to begin."""
        onset, limb = self._onsets.get(side), self.limbs[side]
        if onset is None:
            return
        if onset.felt is None and float(np.linalg.norm(limb.position - onset.own)) > _ONSET:
            onset.felt = self.time
        moved = float(np.linalg.norm(self.sight.hands[side].position - onset.seen))
        if onset.felt is not None and moved > _ONSET:
            self.lag += 0.5 * (self.time - onset.felt - self.lag)
            del self._onsets[side]

    def settle(self, side: str) -> Act:
        """Wait until the robot's hand is seen where it should be, or at rest elsewhere."""
        began, calm = self.time, 0.0
        while self.time - began < _LONGEST_WAIT:
            yield
            calm = calm + self.dt if self._speed[side] < self.traits.still else 0.0
            seen, expected = self.sight.hands[side], self.expected(side)
            off = float(np.linalg.norm(expected.position - seen.position))
            turned = float(np.linalg.norm(rotation_vector(seen.quaternion, expected.quaternion)))
            agrees = off < self.traits.agreement and turned < self.traits.agreement_angle
            if agrees and calm >= 2.0 * self.dt:
                break
            if self.time - began > self.lag + self.traits.patience and calm >= 0.3:
                break
        self._anchors[side] = self._anchored(side)
        return True

    def push(
        self,
        side: str,
        direction: Callable[[Sight], Array],
        distance: float,
        *,
        speed: float,
        until: Sign,
        lead: float = 0.07,
    ) -> Act:
        """Advance steadily until something is seen, never far ahead of what is seen.

        Args:
            side: ``left`` or ``right``.
            direction: unit vector (3,) in the body frame.
            distance: at most so far [m].
            speed: [m/s].
            until: what ends it, after a reaction time.
            lead: the own hand waits when it is this far ahead of the robot's [m].

        Returns:
            whether ``until`` was seen.
        """
        limb, gone, pace, blocked = self.limbs[side], 0.0, 0.0, 0.0
        line = self.sight.hands[side].position
        while gone < distance and not until(self.sight):
            heading = direction(self.sight)
            ahead = self.expected(side).position - self.sight.hands[side].position
            room = float(ahead @ heading) < lead
            pace = min(speed, pace + speed * self.dt / _RAMP) if room else 0.0
            astray = self.sight.hands[side].position - line
            aside = astray - float(astray @ heading) * heading
            limb.drive(pace * heading - _STEER * aside)
            yield
            gone += pace * self.dt
            blocked = 0.0 if room else blocked + self.dt
            if blocked > self.lag + 2.0 * self.traits.patience:
                break
        if until(self.sight):
            yield from self.react()
        limb.stop()
        seen = yield from self.wait_until(until, self.lag + self.traits.patience)
        return seen

    def grip(self, side: str, closure: float) -> Act:
        """Press or open the trigger, and wait until the gripper should have followed."""
        limb = self.limbs[side]
        limb.finger(closure, self.traits.grip_time)
        while limb.finger_busy:
            yield
        yield from self.pause(self.lag + 0.3)
        return True

    def _anchored(self, side: str) -> _Anchor:
        limb = self.limbs[side]
        return _Anchor(self.sight.hands[side], limb.position, limb.quaternion)

    # Feet.

    def gait(self, gait: Gait, tries: int = 6) -> Act:
        """Press the button of a gait and wait until the robot is seen to have done it.

        Raises:
            StrategyError: it was refused or unanswered too often, or aborted.
        """
        for _ in range(tries):
            self._replies.clear()
            before = self.sight.completed
            self._button = _BUTTON_OF[gait]
            yield from self.pause(self.traits.press_time)
            self._button = None
            yield
            outcome = yield from self._await_gait(gait, before)
            if outcome:
                return True
            yield from self.pause(self.vary(0.4, 0.1))
        raise StrategyError(f"{gait.name.lower()} was not done after {tries} presses")

    def _await_gait(self, gait: Gait, before: int) -> Act:
        began, walking = self.time, False
        while True:
            for reply in self._replies:
                if reply.gait is not gait:
                    continue
                if reply.outcome is GaitOutcome.REFUSED and not walking:
                    self._replies.clear()
                    return False
                if reply.outcome is GaitOutcome.ABORTED:
                    raise StrategyError(f"{gait.name.lower()} was aborted: {reply.reason}")
                walking = True
            self._replies.clear()
            walking = walking or not self.sight.balancing
            if self.sight.completed > before and self.sight.balancing:
                return True
            waited = self.time - began
            if not walking and waited > 2.0 * self.lag + self.traits.answer_patience:
                return False
            if waited > 30.0:
                raise StrategyError(f"{gait.name.lower()} did not end within 30 s")
            yield


def offset(pose: Pose, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Pose:
    """``pose`` moved along its own axes [m]."""
    return Pose(pose.place(np.array([x, y, z])), pose.quaternion)


def level(pose: Pose) -> Pose:
    """``pose`` with its heading alone, upright."""
    return Pose(pose.position, from_rpy(0.0, 0.0, pose.yaw))


def turned(pose: Pose, quaternion: Array) -> Pose:
    """A pose at the same place, its orientation multiplied from the right."""
    return Pose(pose.position, multiply(pose.quaternion, quaternion))
