"""Takeover of the robot in any stance: lower a raised foot, then stand up.

A controller that starts, or restarts after a silence, may find the robot on one leg in the middle
of a step. It moves the CoM over the standing foot and lowers the raised one straight down; if the
robot is tipping over already, it lowers the foot at once. Then the CoM moves between the feet.
"""

import numpy as np

from common.robot.rotations import matrix_from_yaw, wrap_angle, yaw_from_matrix
from common.schemas import ControlState
from common.schemas.arrays import Float64Array as Array
from services.wbc.config import WbcConfig
from services.wbc.dcm import natural_frequency
from services.wbc.footsteps import Side, Stance
from services.wbc.references import BodyReference, SwingPair, force_limits, heading
from services.wbc.robot_model import Dynamics, FramePose
from services.wbc.swing import SwingTrajectory, minimum_jerk

RAISED = 0.015
"""Height difference above which the higher sole may be in the air [m]."""
TOUCHING = 30.0
"""Normal force above which a foot stands at any height [N]."""
SHIFT_TIME = 0.5
"""Duration of moving the CoM over the standing foot [s]."""
LOWER_TIME = 0.7
"""Duration of lowering the raised foot [s]."""
URGENT_LOWER_TIME = 0.25
"""The same while the robot tips over [s]."""
CAPTURABLE = 0.75
"""Share of the standing sole within which the DCM can be stopped on one leg."""
LOAD_TIME = 0.3
"""Duration of loading the landed foot [s]."""


class Takeover:
    """References from the first measured state to a balanced stance."""

    def __init__(
        self, dynamics: Dynamics, foot_force: Array, time: float, config: WbcConfig
    ) -> None:
        """Plan the takeover from the first measured state.

        Args:
            dynamics: model terms at the first measured state.
            foot_force: (2,) normal force under the left and right foot [N].
            time: robot time [s].
            config: of the controller.
        """
        self._config = config
        self._start = time
        self._com = dynamics.com_position.copy()
        self._begin: Array | None = None
        self._yaw = yaw_from_matrix(dynamics.base_rotation)
        left, right = (float(foot.position[2]) for foot in dynamics.feet)
        self.raised: Side | None = None
        self._landing = 0.0
        higher: Side = 0 if left > right else 1
        # A tilted sole may be high at its centre although it stands on an edge.
        if abs(left - right) > RAISED and float(foot_force[higher]) < TOUCHING:
            self._plan_landing(dynamics, higher)

    def _plan_landing(self, dynamics: Dynamics, raised: Side) -> None:
        self.raised = raised
        foot, other = dynamics.feet[raised], dynamics.feet[1 - raised]
        if self._capturable(dynamics, other):
            self._shift, lower = SHIFT_TIME, LOWER_TIME
            self._over_foot = np.array([*other.position[:2], self._com[2]])
        else:
            # Tipping over: the foot must land before the CoM is far from both.
            self._shift, lower = 0.0, URGENT_LOWER_TIME
            self._over_foot = self._com
        self._landing = self._shift + lower
        level = matrix_from_yaw(yaw_from_matrix(foot.rotation))
        ground = np.array([*foot.position[:2], other.position[2]])
        self._lowering = SwingTrajectory(
            foot.position.copy(), foot.rotation.copy(), ground, level, 0.0, lower
        )

    def _capturable(self, dynamics: Dynamics, standing: FramePose) -> bool:
        """Return whether the DCM is over the standing sole with a margin."""
        omega = natural_frequency(self._config.gait.com_height)
        dcm = dynamics.com_position + dynamics.com_velocity / omega
        x, y, _ = np.abs(standing.rotation.T @ (dcm - standing.position))
        contact = self._config.contact
        return bool(x < CAPTURABLE * contact.half_length and y < CAPTURABLE * contact.half_width)

    def state(self, time: float) -> ControlState:
        """Return the discrete state: a swing while a foot is in the air, else STAND."""
        if self.raised is None or time - self._start >= self._landing:
            return ControlState.STAND
        return ControlState.LF_SWING if self.raised == 0 else ControlState.RF_SWING

    def done(self, time: float) -> bool:
        """Return whether the takeover is complete."""
        return time - self._start >= self._landing + self._config.stand_time

    def reference(
        self, time: float, com: Array, stance: Stance, com_height: float
    ) -> BodyReference:
        """Return the references at ``time``.

        Args:
            time: robot time [s].
            com: (3,) measured CoM in world [m].
            stance: measured stance of the feet.
            com_height: final CoM height in world [m].
        """
        elapsed = time - self._start
        if elapsed < self._landing:
            return self._landing_reference(elapsed)
        goal = np.array([*stance.position, com_height])
        length = self._config.stand_time
        if self._begin is None:
            self._begin = com.copy()
        begin = self._begin
        s, sd, sdd = minimum_jerk((elapsed - self._landing) / length, length)
        yaw = self._yaw + s * wrap_angle(stance.yaw - self._yaw)
        offset = goal - begin
        return self._body(
            (begin + s * offset, sd * offset, sdd * offset), yaw, (None, None), self._load(elapsed)
        )

    def _landing_reference(self, elapsed: float) -> BodyReference:
        s, sd, sdd = minimum_jerk(elapsed / SHIFT_TIME, SHIFT_TIME)
        offset = self._over_foot - self._com
        lowering = self._lowering.at(elapsed - self._shift)
        swing = (lowering, None) if self.raised == 0 else (None, lowering)
        motion = (self._com + s * offset, sd * offset, sdd * offset)
        return self._body(motion, self._yaw, swing, self._load(elapsed))

    def _load(self, elapsed: float) -> tuple[float, float]:
        if self.raised is None:
            return 1.0, 1.0
        landed = min(1.0, max(0.0, (elapsed - self._landing) / LOAD_TIME))
        return (landed, 1.0) if self.raised == 0 else (1.0, landed)

    def _body(
        self,
        motion: tuple[Array, Array, Array],
        yaw: float,
        swing: SwingPair,
        load: tuple[float, float],
    ) -> BodyReference:
        com, velocity, acceleration = motion
        limits = force_limits(load, self._config.contact.normal_force_max)
        return BodyReference(
            com, velocity, acceleration, com[:2], heading(yaw), swing, limits, load
        )
