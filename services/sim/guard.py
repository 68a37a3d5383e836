"""Command guard: decides whether the motors follow the controller, hold, or go limp.

The controller may be wrong, the guard not; hence it is small, knows neither physics nor transport,
and every branch of it is tested.

Silence is counted in robot time from the *stamp* of the command in force, that is from the
measurement behind it, and not from its reception: a command that was late on its way is worth no
more than one that was late in coming. So no torque rests on a measurement older than
``hold_after``, whatever the network does, and nothing ages while the plant is paused.
"""

from enum import Enum

import numpy as np

from common.schemas import GuardMode, JointCommand
from services.sim import limits
from services.sim.config import GuardConfig


class Refusal(Enum):
    """Why a command was not applied."""

    ESTOPPED = "emergency stop is latched: reset the plant"
    FALLEN = "the robot has fallen: reset the plant"
    BEFORE_RESET = "made from a state before the last reset"
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


def refuse_values(command: JointCommand) -> Refusal | None:
    """Return why the numbers in ``command`` cannot be applied, or None."""
    position, closure = command.position, command.gripper_closure
    everything = (
        position,
        command.velocity,
        command.acceleration,
        command.torque,
        command.stiffness,
        command.damping,
        closure,
    )
    if not np.isfinite(np.concatenate(everything)).all():
        return Refusal.NOT_FINITE
    checks = (
        (Refusal.STIFFNESS, command.stiffness, 0.0, limits.STIFFNESS_MAX),
        (Refusal.DAMPING, command.damping, 0.0, limits.DAMPING_MAX),
        (Refusal.POSITION, position, limits.POSITION_MIN, limits.POSITION_MAX),
        (Refusal.VELOCITY, np.abs(command.velocity), 0.0, limits.VELOCITY_MAX),
        (Refusal.ACCELERATION, np.abs(command.acceleration), 0.0, limits.ACCELERATION_MAX),
        (Refusal.TORQUE, np.abs(command.torque), 0.0, limits.TORQUE_MAX),
        (Refusal.GRIPPER, closure, -limits.CLOSURE_MARGIN, 1.0 + limits.CLOSURE_MARGIN),
    )
    for refusal, value, low, high in checks:
        if not ((value >= low) & (value <= high)).all():
            return refusal
    return None


class Guard:
    """The state machine SILENT → ACTIVE ⇄ HOLD → DAMP, with a latched ESTOP.

    A fresh valid command returns to ACTIVE from HOLD and DAMP; a fallen robot stays in DAMP and
    ESTOP is left only by :meth:`reset`.

    Attributes:
        mode: what the motors shall do.
        command: the last good command since the reset, which stands until a better one.
        applied, refused, holds: counts over the guard's life.
        last_refusal: why the latest refused command was refused.
    """

    def __init__(self, config: GuardConfig) -> None:
        self._hold_after_ns = round(config.hold_after * 1e9)
        self._damp_after_ns = round(config.damp_after * 1e9)
        self.applied = 0
        self.refused = 0
        self.holds = 0
        self.last_refusal: Refusal | None = None
        self.reset(-1)

    def reset(self, epoch_ns: int) -> None:
        """Return to SILENT; commands stamped at or before ``epoch_ns`` (robot time) are void."""
        self.mode = GuardMode.SILENT
        self.command: JointCommand | None = None
        self._epoch_ns = epoch_ns
        self._fallen = False

    def estop(self) -> None:
        """Latch the emergency stop."""
        self.mode = GuardMode.ESTOP

    def offer(self, command: JointCommand, now_ns: int) -> bool:
        """Judge ``command`` at robot time ``now_ns``; whether it is now in force."""
        refusal = self._refuse(command, now_ns)
        if refusal is not None:
            self.refused += 1
            self.last_refusal = refusal
            return False
        self.applied += 1
        self.command = command
        self.mode = GuardMode.ACTIVE
        return True

    def tick(self, now_ns: int, fallen: bool) -> GuardMode:
        """Let robot time pass to ``now_ns``; ``fallen`` latches until the reset."""
        self._fallen |= fallen
        if self.mode is GuardMode.ESTOP:
            return self.mode
        if self._fallen:
            self.mode = GuardMode.DAMP
        elif self.command is not None:
            silence = now_ns - self.command.header.stamp
            if silence > self._damp_after_ns:
                self.mode = GuardMode.DAMP
            elif silence > self._hold_after_ns and self.mode is GuardMode.ACTIVE:
                self.mode = GuardMode.HOLD
                self.holds += 1
        return self.mode

    def _refuse(self, command: JointCommand, now_ns: int) -> Refusal | None:
        if self.mode is GuardMode.ESTOP:
            return Refusal.ESTOPPED
        if self._fallen:
            return Refusal.FALLEN
        return self._refuse_stamp(command.header.stamp, now_ns) or refuse_values(command)

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
