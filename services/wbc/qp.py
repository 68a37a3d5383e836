"""The whole-body QP (Seo et al. 2023, eq. 1) as matrices of fixed layout.

Variables x = [qdd (31); f_left (6); f_right (6)]. Rows of A, bounded by l <= A x <= u:

    0..5    floating base: S_f (M qdd + h - J' f) = 0
    6..30   motor torques: tau_min <= S_a (M qdd + h - J' f) <= tau_max
    31..47  wrench cone of the left foot, 48..64 of the right: U f >= 0
    65, 66  normal forces: fz <= fz_max(t)
    67..91  joint accelerations: qdd_min <= qdd <= qdd_max (25 motors)

Besides, parts of the robot that are near each other are kept apart by soft rows, of which there are
as many as such pairs: B qdd >= b, their violation being the last resort.
"""

from dataclasses import dataclass, field

import numpy as np

from common.native import kernel
from common.robot import joints
from common.schemas.arrays import Float64Array as Array
from services.wbc.clearance import Clearance
from services.wbc.config import ContactConfig, WbcConfig
from services.wbc.layout import ARMS, NUM_MOTORS, NV
from services.wbc.robot_model import Dynamics
from services.wbc.tasks import TaskStack

CONE_ROWS = 17
FZ = 2
"""Index of the normal force in a wrench."""
NUM_VARIABLES = NV + 12
DYNAMICS = slice(0, NV)
TORQUE = slice(6, NV)
CONES = slice(NV, NV + 2 * CONE_ROWS)
NORMAL = slice(NV + 2 * CONE_ROWS, NV + 2 * CONE_ROWS + 2)
BOUNDS = slice(NORMAL.stop, NORMAL.stop + NUM_MOTORS)
NUM_CONSTRAINTS = BOUNDS.stop
ARM_BOUNDS = slice(BOUNDS.start + ARMS.start, BOUNDS.start + ARMS.stop)
"""Rows of the arms' accelerations."""
INFINITY = 1e20
SEPARATION_MAX = 50.0
"""Limit of the acceleration at which near parts are made to separate [m/s²]."""
AIRBORNE = 2.0
"""Normal force limit up to which a foot gets no wrench at all [N]."""
FORCES = (slice(NV, NV + 6), slice(NV + 6, NV + 12))


def wrench_cone(config: ContactConfig) -> Array:
    """Return the wrench cone U (17, 6) of a rectangular sole: U f >= 0.

    The rows are unilateral contact, friction pyramid, centre of pressure and yaw torque. A wrench f
    is [fx, fy, fz, mx, my, mz] in the sole's own frame (z up, origin at the centre), so that U is
    constant (Caron, Pham, Nakamura 2015, eq. 13-16).
    """
    mu, x, y = config.friction, config.half_length, config.half_width
    rows = [[0.0, 0.0, 1.0, 0.0, 0.0, 0.0]]
    for sign in (1.0, -1.0):
        rows.append([sign, 0.0, mu, 0.0, 0.0, 0.0])
        rows.append([0.0, sign, mu, 0.0, 0.0, 0.0])
        rows.append([0.0, 0.0, y, sign, 0.0, 0.0])
        rows.append([0.0, 0.0, x, 0.0, sign, 0.0])
    reach = mu * (x + y)
    for a in (1.0, -1.0):
        for b in (1.0, -1.0):
            # Lower and upper bound of mz, each for the four sign patterns.
            rows.append([a * y, b * x, reach, -a * mu, -b * mu, 1.0])
            rows.append([a * y, b * x, reach, a * mu, b * mu, -1.0])
    return np.array(rows)


@dataclass
class QpData:
    """Matrices of min 1/2 x' P x + q' x subject to l <= A x <= u, overwritten at every tick.

    Attributes:
        B: (k, 31) soft rows, B qdd >= b.
        b: (k,) their lower bounds [m/s²].
    """

    P: Array = field(default_factory=lambda: np.zeros((NUM_VARIABLES, NUM_VARIABLES)))
    q: Array = field(default_factory=lambda: np.zeros(NUM_VARIABLES))
    A: Array = field(default_factory=lambda: np.zeros((NUM_CONSTRAINTS, NUM_VARIABLES)))
    l: Array = field(default_factory=lambda: np.full(NUM_CONSTRAINTS, -INFINITY))  # noqa: E741
    u: Array = field(default_factory=lambda: np.full(NUM_CONSTRAINTS, INFINITY))
    B: Array = field(default_factory=lambda: np.zeros((0, NV)))
    b: Array = field(default_factory=lambda: np.zeros(0))

    def shortfall(self, x: Array) -> float:
        """Return by how much a solution misses the worst of the soft rows [m/s²]."""
        return float(np.max(self.b - self.B.dot(x[:NV]), initial=-np.inf))


class QpBuilder:
    """Fills :class:`QpData`; constants are written once."""

    def __init__(self, config: WbcConfig) -> None:
        self._config = config
        limits = config.limits
        effort = joints.EFFORT_RELAXED if limits.torque_mode == "relaxed" else joints.EFFORT_RATED
        # A motor coordinate carries the torque of every hinge it turns: twice for a knee.
        self.torque_limit: Array = joints.MOTOR_TO_JOINT.T @ effort
        # No motor turns the floating base.
        self._highest_torque = np.concatenate((np.zeros(6), self.torque_limit))
        self._lowest_torque = -self._highest_torque
        index = np.array(joints.MOTOR_POSITION_INDEX)[ARMS]
        self._arm_limits = np.array(
            (
                joints.POSITION_LOWER[index] + limits.joint_margin,
                joints.POSITION_UPPER[index] - limits.joint_margin,
            )
        )
        self.data = QpData()
        self._write_constants()
        self._compiled = kernel("services.wbc._qp")
        self._scalars = (
            config.tasks.acceleration_regulariser, config.tasks.force_reference_weight,
            limits.joint_stiffness, limits.joint_damping, limits.acceleration_max,
            AIRBORNE, INFINITY,
        )  # fmt: skip

    def _write_constants(self) -> None:
        data, tasks = self.data, self._config.tasks
        cone = wrench_cone(self._config.contact)
        for side, columns in enumerate(FORCES):
            first = CONES.start + side * CONE_ROWS
            data.A[first : first + CONE_ROWS, columns] = cone
            data.A[NORMAL.start + side, columns.start + FZ] = 1.0
        data.l[CONES] = 0.0
        data.A[BOUNDS, 6:NV] = np.eye(NUM_MOTORS)
        data.l[BOUNDS] = -self._config.limits.acceleration_max
        data.u[BOUNDS] = self._config.limits.acceleration_max
        diagonal = np.arange(NV, NUM_VARIABLES)
        data.P[diagonal, diagonal] = tasks.force_regulariser + tasks.force_reference_weight
        self._regulariser = tasks.acceleration_regulariser
        # Views of what changes at every tick; of each foot, its columns and its cone's bounds.
        self._mass = data.A[DYNAMICS, :NV]
        self._lowest, self._highest = data.l[DYNAMICS], data.u[DYNAMICS]
        self._contacts = tuple(
            (data.A[DYNAMICS, columns], data.l[CONES][side * CONE_ROWS :][:CONE_ROWS])
            for side, columns in enumerate(FORCES)
        )
        self._diagonal = data.P.ravel()[: NV * NUM_VARIABLES : NUM_VARIABLES + 1]

    def build(
        self,
        dynamics: Dynamics,
        stack: TaskStack,
        normal_force_max: tuple[float, float],
        normal_force_desired: tuple[float, float],
    ) -> QpData:
        """Write the matrices of one tick and return them.

        Args:
            dynamics: model terms at the measured state.
            stack: filled tasks.
            normal_force_max: upper bound of each foot's normal force [N].
            normal_force_desired: f_r^d of eq. 1, normal components [N].
        """
        if self._compiled is None:
            self._fill(dynamics, stack, normal_force_max, normal_force_desired)
        else:
            data = self.data
            self._compiled.fill(
                data.P, data.q, data.A, data.l, data.u, stack.rows, stack.weight,
                dynamics.motor_position, dynamics.motor_velocity, dynamics.mass_matrix,
                dynamics.bias_force, dynamics.sole_jacobians, self._highest_torque,
                self._arm_limits, *normal_force_max, *normal_force_desired, *self._scalars,
            )  # fmt: skip
        clearance = dynamics.clearance
        self.data.B, self.data.b = clearance.jacobian, clearance.distance
        if clearance.pairs:
            self.data.b = self._apart(clearance)
        return self.data

    def _fill(
        self,
        dynamics: Dynamics,
        stack: TaskStack,
        normal_force_max: tuple[float, float],
        normal_force_desired: tuple[float, float],
    ) -> None:
        """Write what the kernel does, where it is not built."""
        data = self.data
        data.P[:NV, :NV], data.q[:NV] = stack.quadratic()
        self._diagonal += self._regulariser
        weight = self._config.tasks.force_reference_weight
        self._mass[:] = dynamics.mass_matrix
        for side, (wrench, cone) in enumerate(self._contacts):
            if normal_force_max[side] > AIRBORNE:
                np.negative(dynamics.sole_jacobians[side].T, out=wrench)
                cone[:], data.u[NORMAL.start + side] = 0.0, normal_force_max[side]
            else:
                # No wrench at all is equivalent to a cone squeezed to a point, but has no
                # degenerate corner, in which a first-order solver converges slowly.
                wrench[:] = 0.0
                cone[:], data.u[NORMAL.start + side] = -INFINITY, INFINITY
            data.q[FORCES[side].start + FZ] = -weight * normal_force_desired[side]
        np.subtract(self._lowest_torque, dynamics.bias_force, out=self._lowest)
        np.subtract(self._highest_torque, dynamics.bias_force, out=self._highest)
        data.l[ARM_BOUNDS], data.u[ARM_BOUNDS] = self._arm_bounds(dynamics)

    def _apart(self, clearance: Clearance) -> Array:
        """Return the accelerations (k,) at which near parts must at least separate [m/s²].

        They are a second-order barrier: an approach slows down exponentially towards the margin.
        Jdot v is left out, for it is small beside the damping.
        """
        limits = self._config.limits
        gap = clearance.distance - limits.clearance_margin
        wanted: Array = -limits.clearance_stiffness * gap
        wanted -= limits.clearance_damping * clearance.rate
        return np.minimum(wanted, SEPARATION_MAX)

    def _arm_bounds(self, dynamics: Dynamics) -> Array:
        """Return acceleration bounds (2, 12), lower and upper, that keep arms inside their limits.

        They are a second-order barrier. Without them a hand task beyond a limit would be achieved
        by a fast motion of the torso.
        """
        limits = self._config.limits
        cap = limits.acceleration_max
        bounds = self._arm_limits - dynamics.motor_position[ARMS]
        bounds *= limits.joint_stiffness
        bounds -= limits.joint_damping * dynamics.motor_velocity[ARMS]
        return np.minimum(np.maximum(bounds, -cap), cap)

    def torques(self, dynamics: Dynamics, solution: Array) -> Array:
        """Return the motor torques (25,) of a solution: S_a (M qdd + h - J' f) [N·m]."""
        tau: Array = self.data.A[TORQUE].dot(solution) + dynamics.bias_force[6:]
        return tau
