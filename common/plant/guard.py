"""Command guard: decides whether the motors follow the controller, hold, or go limp.

They follow the commands in mode ACTIVE. They hold a posture in SILENT (the initial one, before the
first command) and in HOLD (the present one, while the command in force is too old). They go limp,
that is they are only damped, in DAMP and ESTOP. :class:`~common.schemas.GuardMode` defines the
modes.

The guard must be right where the controller may be wrong. It is therefore small, independent of
physics and transport, and tested in every branch.

Silence is counted in robot time from the *stamp* of the command in force, that is from the
measurement behind it, and not from its reception. A delay in the network thus counts like a delay
in the controller: no torque is based on a measurement older than ``hold_after``, and nothing ages
while the plant is paused.
"""

from enum import Enum
from typing import Final

import numpy as np

from common.plant import limits, reentry
from common.plant.config import GuardConfig
from common.plant.stop import StopRecord
from common.robot.joints import NUM_JOINTS
from common.schemas import NOBODY, GuardMode, JointCommand, Sender
from common.schemas.arrays import Float64Array as Array


class Refusal(Enum):
    """Reason for which a command was not applied."""

    ESTOPPED = "emergency stop is latched: clear it with trill resume"
    FALLEN = "the robot has fallen: reset the plant"
    OTHER_CONTROLLER = "another controller has the robot"
    BEFORE_RESET = "made from a state before the last reset or cleared stop"
    FROM_FUTURE = "stamped later than robot time"
    OUT_OF_ORDER = "older than the command in force"
    TOO_OLD = "made from a state older than hold_after"
    NOT_FINITE = "holds NaN or infinity"
    STIFFNESS = "stiffness negative or too high"
    DAMPING = "damping negative or too high"
    POSITION = "position out of range"
    VELOCITY = "velocity out of range"
    ACCELERATION = "acceleration out of range"
    TORQUE = "feed-forward torque out of range"
    GRIPPER = "gripper closure outside 0..1"
    FAR = "a joint is commanded too far from where it is, while the robot is taken over"
    NO_BEAT = "no emergency stop button is heard, and one is required"


_ZERO = np.zeros(NUM_JOINTS)
_RANGES: Final = (
    (Refusal.STIFFNESS, _ZERO, limits.STIFFNESS_MAX),
    (Refusal.DAMPING, _ZERO, limits.DAMPING_MAX),
    (Refusal.POSITION, limits.POSITION_MIN, limits.POSITION_MAX),
    (Refusal.VELOCITY, -limits.VELOCITY_MAX, limits.VELOCITY_MAX),
    (Refusal.ACCELERATION, -limits.ACCELERATION_MAX, limits.ACCELERATION_MAX),
    (Refusal.TORQUE, -limits.TORQUE_MAX, limits.TORQUE_MAX),
    (Refusal.GRIPPER, np.full(2, -limits.CLOSURE_MARGIN), np.full(2, 1.0 + limits.CLOSURE_MARGIN)),
)
"""Lowest and highest value of each part of a command, in the order of the checks."""
_LOWEST: Final = np.concatenate([low for _, low, _ in _RANGES])
_HIGHEST: Final = np.concatenate([high for _, _, high in _RANGES])


def refuse_values(command: JointCommand) -> Refusal | None:
    """Return why the numbers in ``command`` cannot be applied; None if they can."""
    values = np.concatenate(
        (
            command.stiffness,
            command.damping,
            command.position,
            command.velocity,
            command.acceleration,
            command.torque,
            command.gripper_closure,
        )
    )
    # NaN compares as out of range.
    allowed = (values >= _LOWEST) & (values <= _HIGHEST)
    # Several times faster than .all() on arrays this small.
    if b"\0" not in allowed.tobytes():
        return None
    if not np.isfinite(values).all():
        return Refusal.NOT_FINITE
    first = int(np.argmin(allowed)) // NUM_JOINTS
    return _RANGES[first][0]


class Guard:
    """The state machine SILENT → ACTIVE ⇄ HOLD → DAMP, with a latched ESTOP.

    It obeys one controller, told by the sender of its commands, until that is silent or the robot
    is reset. A fresh valid command returns to ACTIVE from HOLD and DAMP, near the measured posture
    (:mod:`common.plant.reentry`). A fallen robot stays in DAMP until :meth:`reset`; ESTOP is left
    only by :meth:`clear`, and then for DAMP.

    Attributes:
        mode: present state.
        command: last command applied since the reset or the clear; None: none.
        stop: the emergency stops so far, and whether one is latched.
        applied, refused, foreign, holds: counts since construction; foreign ones, those of a
            controller that is not obeyed, are among the refused.
        last_refusal: reason of the last refusal; None: none yet.
        last_refused: sender of the command that was refused last.
    """

    mode: GuardMode
    command: JointCommand | None
    _controller: Sender | None

    def __init__(self, config: GuardConfig, stop: StopRecord | None = None) -> None:
        """Create a silent guard, or a stopped one if ``stop`` is latched."""
        self._hold_after_ns = round(config.hold_after * 1e9)
        self._damp_after_ns = round(config.damp_after * 1e9)
        self._takeover_after_ns = round(config.takeover_after * 1e9)
        self._beat_timeout_ns = round(config.stop_beat_timeout * 1e9)
        self.applied = 0
        self.refused = 0
        self.foreign = 0
        self.holds = 0
        self.last_refusal: Refusal | None = None
        self.last_refused = NOBODY
        self.stop = stop or StopRecord()
        self._beat_ns: int | None = None
        self.reset(-1)

    def reset(self, epoch_ns: int) -> None:
        """Return to SILENT, or to ESTOP if a stop is latched.

        Commands stamped at or before robot time ``epoch_ns`` are refused from now on.
        """
        self._forget(epoch_ns)
        self._fallen = False
        self.mode = GuardMode.ESTOP if self.stop.latched else GuardMode.SILENT

    def estop(self, by: str, reason: str) -> None:
        """Latch the emergency stop; ``by`` names who pressed the button."""
        self.stop = self.stop.pressed(by, reason)
        self.mode = GuardMode.ESTOP

    def clear(self, stops: int, now_ns: int) -> bool:
        """End the latched stop if its number is ``stops``; return whether it was.

        The joints are damped until a command made after robot time ``now_ns`` [ns] is applied.
        """
        stop = self.stop.cleared(stops)
        if stop is self.stop:
            return False
        self.stop = stop
        self._forget(now_ns)
        self.mode = GuardMode.DAMP
        return True

    def beat(self, now_ns: int) -> None:
        """Note at robot time ``now_ns`` [ns] that somebody's stop button is there."""
        self._beat_ns = now_ns

    @property
    def controller(self) -> Sender | None:
        """The controller that is obeyed now; None while none is."""
        return self._controller if self.mode is GuardMode.ACTIVE else None

    def offer(self, command: JointCommand, now_ns: int, measured: Array) -> bool:
        """Check a command and return whether it is applied.

        Args:
            command: the command.
            now_ns: robot time [ns].
            measured: (27,) joint positions now [rad].
        """
        sender, stamp = command.header.sender, command.header.stamp
        refusal = self._refuse(command, now_ns, measured)
        if refusal is not None:
            self.refused += 1
            self.foreign += refusal is Refusal.OTHER_CONTROLLER
            self.last_refusal, self.last_refused = refusal, sender
            return False
        if self.mode is not GuardMode.ACTIVE:
            self._entered_ns = now_ns
        self.applied += 1
        self.command, self._controller, self._heard_ns = command, sender, stamp
        self.mode = GuardMode.ACTIVE
        return True

    def eased(self, position: Array, now_ns: int, measured: Array) -> Array:
        """Return the set-points (27,) to apply for those of a command just applied [rad]."""
        if not self._is_entering(now_ns):
            return position
        return reentry.eased(position, measured, now_ns - self._entered_ns)

    def tick(self, now_ns: int, fallen: bool) -> GuardMode:
        """Advance to robot time ``now_ns`` [ns] and return the mode.

        Args:
            now_ns: robot time [ns].
            fallen: whether the robot has fallen; latched until the reset.
        """
        self._fallen |= fallen
        if self.mode is GuardMode.ESTOP:
            return self.mode
        if self._fallen:
            self.mode = GuardMode.DAMP
        elif self.command is not None:
            silence = now_ns - self._heard_ns
            if silence > self._damp_after_ns:
                self.mode = GuardMode.DAMP
            elif self.mode is GuardMode.ACTIVE and (
                silence > self._hold_after_ns or not self._is_watched(now_ns)
            ):
                self.mode = GuardMode.HOLD
                self.holds += 1
        return self.mode

    def settled_until_ns(self) -> int | None:
        """Return the last robot time at which :meth:`tick` gives the present mode [ns]; None: ever.

        Provided that the robot does not fall, and that nothing is offered, stopped, cleared or
        heard before.
        """
        if self.command is None or self._fallen or self.mode in (GuardMode.ESTOP, GuardMode.DAMP):
            return None
        limits_ns = [self._heard_ns + self._damp_after_ns]
        if self.mode is GuardMode.ACTIVE:
            limits_ns.append(self._heard_ns + self._hold_after_ns)
            if self._beat_timeout_ns:
                beat_ns = self._epoch_ns if self._beat_ns is None else self._beat_ns
                limits_ns.append(beat_ns + self._beat_timeout_ns)
        return min(limits_ns)

    def _forget(self, epoch_ns: int) -> None:
        """Forget the command in force and who sent it."""
        self.command = self._controller = None
        self._epoch_ns = self._heard_ns = self._entered_ns = epoch_ns

    def _is_entering(self, now_ns: int) -> bool:
        """Return whether the first command in a row was applied a short while ago."""
        return now_ns - self._entered_ns <= reentry.DURATION_NS

    def _is_watched(self, now_ns: int) -> bool:
        """Return whether a stop button was heard within the timeout, if one is required."""
        if not self._beat_timeout_ns:
            return True
        return self._beat_ns is not None and now_ns - self._beat_ns <= self._beat_timeout_ns

    def _refuse(self, command: JointCommand, now_ns: int, measured: Array) -> Refusal | None:
        refusal = (
            self._refuse_sender(command.header.sender, now_ns)
            or self._refuse_stamp(command.header.stamp, now_ns)
            or refuse_values(command)
        )
        if refusal is not None:
            return refusal
        entered = self.mode is GuardMode.ACTIVE and not self._is_entering(now_ns)
        if not entered and reentry.is_far(command, now_ns, measured):
            return Refusal.FAR
        if not self._is_watched(now_ns):
            # Its sender is alive: the robot is held for want of a button and must not go limp.
            self._heard_ns = command.header.stamp
            return Refusal.NO_BEAT
        return None

    def _refuse_sender(self, sender: Sender, now_ns: int) -> Refusal | None:
        if self.mode is GuardMode.ESTOP:
            return Refusal.ESTOPPED
        if self._fallen:
            return Refusal.FALLEN
        return Refusal.OTHER_CONTROLLER if self._is_foreign(sender, now_ns) else None

    def _is_foreign(self, sender: Sender, now_ns: int) -> bool:
        """Return whether another controller than this one is obeyed, or may still come back."""
        if self._controller is None or self._controller == sender:
            return False
        if self.mode is GuardMode.ACTIVE:
            return True
        silence = now_ns - self._heard_ns
        return sender.source != self._controller.source and silence <= self._takeover_after_ns

    def _refuse_stamp(self, stamp_ns: int, now_ns: int) -> Refusal | None:
        if stamp_ns <= self._epoch_ns:
            return Refusal.BEFORE_RESET
        if stamp_ns > now_ns:
            return Refusal.FROM_FUTURE
        if self.command is not None and stamp_ns < self.command.header.stamp:
            return Refusal.OUT_OF_ORDER
        if now_ns - stamp_ns > self._hold_after_ns:
            return Refusal.TOO_OLD
        return None
