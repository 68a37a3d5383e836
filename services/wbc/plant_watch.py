"""Whether the robot is where the plans expect it, and does what the controller commands; pure."""

from common.schemas import GuardMode, PlantState
from services.wbc.plant_check import torque_misfit

LONGEST_GAP_NS = 120_000_000
"""Time without a state, or without obedience, after which plans are too far ahead [ns]."""
LONGEST_HOLD_NS = 50_000_000
"""A hold of the plant's guard up to this length does not end a gait [ns]."""


class PlantWatch:
    """Compares each state of the plant with the one before.

    Attributes:
        obstacle: why the robot does not do what the controller commands; empty: it does.
        bystander: whether it does what another controller commands.
        misfit: why this plant must not be commanded at all; empty: it may.
        stopped: whether an emergency stop is on, or was since the state before. A stop may begin
            and end between two states: while the plant is paused, or while the controller hangs.
    """

    def __init__(self, torque_mode: str) -> None:
        """Watch a plant for a controller that plans with the limits of ``torque_mode``."""
        self._torque_mode = torque_mode
        self.obstacle = self.misfit = ""
        self.bystander = self.stopped = False
        self._stamp = -1
        self._reset_count = self._stops = 0
        self._obeyed = self._restarted = 0

    def update(self, state: PlantState, boot: int) -> str:
        """Return why the controller has to take the robot over afresh; empty: it goes on.

        As long as the robot does not obey, that comes again and again, so that the controller never
        commands anything far from the measured posture.

        Args:
            state: newer than the last one, or of a plant that was restarted.
            boot: id of this run of the controller.
        """
        stamp = state.header.stamp
        first = self._stamp < 0
        missed = not first and state.stops > self._stops and state.guard is not GuardMode.ESTOP
        reason = "" if first else self._interruption(state)
        if missed and not reason:
            reason = "there was an emergency stop"
        if first or reason or state.guard is GuardMode.ACTIVE:
            self._obeyed = stamp
        self._stamp, self._reset_count, self._stops = stamp, state.reset_count, state.stops
        self.stopped = missed or state.guard is GuardMode.ESTOP
        self.misfit = torque_misfit(self._torque_mode, state)
        self.obstacle = self.misfit or self._find_obstacle(state, boot)
        if self.obstacle and not reason and stamp - self._restarted > LONGEST_GAP_NS:
            reason = self.obstacle
        if first or reason:
            self._restarted = stamp
        return reason

    def _interruption(self, state: PlantState) -> str:
        """Return why the robot may have moved since the last state without the controller."""
        gap = state.header.stamp - self._stamp
        if state.reset_count != self._reset_count or gap < 0:
            return "the plant was reset"
        if gap > LONGEST_GAP_NS:
            return f"the controller was silent for {gap * 1e-9:.2f} s"
        return ""

    def _find_obstacle(self, state: PlantState, boot: int) -> str:
        guard = state.guard
        # A controller that is not followed any more soon loses the plant to this one.
        self.bystander = guard is GuardMode.ACTIVE and state.controller_boot not in (0, boot)
        if guard is GuardMode.ESTOP:
            return "the emergency stop is on"
        if state.fallen:
            return "the robot has fallen"
        if self.bystander:
            return "another controller has the plant"
        if guard is GuardMode.DAMP:
            return "the robot is limp, for no command reached it for long"
        if state.header.stamp - self._obeyed > LONGEST_HOLD_NS:
            return "the plant holds the robot and applies no command"
        return ""
