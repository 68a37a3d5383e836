"""Command guard: decides whether the motors follow the controller, hold, or go limp.

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

from common.plant import limits
from common.plant.config import GuardConfig
from common.robot.joints import NUM_JOINTS
from common.schemas import GuardMode, JointCommand


class Refusal(Enum):
    """Reason for which a command was not applied."""

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
    if allowed.all():
        return None
    if not np.isfinite(values).all():
        return Refusal.NOT_FINITE
    first = int(np.argmin(allowed)) // NUM_JOINTS
    return _RANGES[first][0]


class Guard:
    """The state machine SILENT → ACTIVE ⇄ HOLD → DAMP, with a latched ESTOP.

    A fresh valid command returns to ACTIVE from HOLD and DAMP; a fallen robot stays in DAMP and
    ESTOP is left only by :meth:`reset`.

    Attributes:
        mode: present state.
        command: last command applied since the reset; None: none.
        applied, refused, holds: counts since construction.
        last_refusal: reason of the last refusal; None: none yet.
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
        """Return to SILENT; commands stamped at or before robot time ``epoch_ns`` are refused."""
        self.mode = GuardMode.SILENT
        self.command: JointCommand | None = None
        self._epoch_ns = epoch_ns
        self._fallen = False

    def estop(self) -> None:
        """Latch the emergency stop."""
        self.mode = GuardMode.ESTOP

    def offer(self, command: JointCommand, now_ns: int) -> bool:
        """Check a command at robot time ``now_ns`` [ns] and return whether it is applied."""
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
