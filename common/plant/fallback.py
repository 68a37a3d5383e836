"""Motor targets without a valid command: put a raised foot down and hold, or only damp."""

from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from common.plant.servo import Target, motor_target
from common.robot.joints import JOINTS, LEFT_LEG, NUM_JOINTS, RIGHT_LEG
from common.robot.kinematics import foot_in_body, leg_reaching
from common.robot.pose import Pose
from common.robot.rotations import multiply
from common.schemas.arrays import Float64Array as Array

_HOLD: Final[dict[str, tuple[float, float]]] = {
    "hip_ie": (1250.0, 10.0),
    "hip_aa": (2000.0, 25.0),
    "hip_fe": (2000.0, 25.0),
    "knee_fe_jp": (2000.0, 8.0),
    "knee_fe_jd": (2000.0, 8.0),
    "ankle_fe": (2000.0, 6.0),
    "ankle_ie": (2000.0, 6.0),
    "shoulder_fe": (100.0, 4.0),
    "shoulder_aa": (100.0, 6.0),
    "shoulder_ie": (60.0, 2.0),
    "elbow_fe": (60.0, 2.0),
    "wrist_ps": (20.0, 0.8),
    "wrist_pitch": (20.0, 0.8),
    "neck_pitch": (20.0, 0.8),
}
"""Stiffness [N·m/rad] and damping [N·m·s/rad] per joint while holding.

A standing robot is an inverted pendulum: it topples unless its legs are stiffer than
m g h = 36.5 kg · 9.81 m/s² · 0.7 m = 250 N·m/rad. On one leg a hip, a knee of two hinges and an
ankle are in series. With 2000 N·m/rad each they make 800, and a lean grows 1.5-fold; with 800 each
they would make 320, and it would grow 4.6-fold, off the sole. The servo at 1 kHz bears it: a foot
in the air has M = 0.012 kg·m², so kp dt² / M = 0.17 (stable below 4) and kd dt / M = 0.5 (below 1).
"""

_DAMP: Final[dict[str, float]] = {
    "hip_ie": 8.0,
    "hip_aa": 20.0,
    "hip_fe": 20.0,
    "knee_fe_jp": 8.0,
    "knee_fe_jd": 8.0,
    "ankle_fe": 5.0,
    "ankle_ie": 5.0,
    "shoulder_fe": 3.0,
    "shoulder_aa": 3.0,
    "shoulder_ie": 2.0,
    "elbow_fe": 2.0,
    "wrist_ps": 0.6,
    "wrist_pitch": 0.6,
    "neck_pitch": 0.6,
}
"""Damping per joint without a hold, so that the robot sinks and does not drop [N·m·s/rad]."""


def _kind(name: str) -> str:
    return name.removeprefix("l_").removeprefix("r_")


HOLD_STIFFNESS: Final[Array] = np.array([_HOLD[_kind(joint.name)][0] for joint in JOINTS])
HOLD_DAMPING: Final[Array] = np.array([_HOLD[_kind(joint.name)][1] for joint in JOINTS])
DAMP_DAMPING: Final[Array] = np.array([_DAMP[_kind(joint.name)] for joint in JOINTS])
_ZERO: Final[Array] = np.zeros(NUM_JOINTS)
_SIDES: Final = ("left", "right")
_LEGS: Final = (LEFT_LEG, RIGHT_LEG)

LOWERING_NS: Final = 300_000_000
"""Duration of putting a raised foot down [ns]: before the robot tips far, and without a kick."""
CARRYING: Final = 30.0
"""Normal force from which a foot carries [N]."""
HIGHEST: Final = 0.15
"""Height of a sole above the other from which it is not merely in mid-swing [m]."""
REACHED: Final = 0.005
"""Largest distance at which a leg still reaches the ground [m]."""


def hold_target(now_ns: int, position: Array, torque: Array, velocity: Array = _ZERO) -> Target:
    """Return the target that holds a posture stiffly, or moves through it.

    Args:
        now_ns: robot time [ns].
        position: (27,) [rad].
        torque: (27,) feed-forward [N·m].
        velocity: (27,) [rad/s].
    """
    return motor_target(now_ns, position, velocity, _ZERO, torque, HOLD_STIFFNESS, HOLD_DAMPING)


def damp_target(now_ns: int) -> Target:
    """Return the target that damps motion and holds no position."""
    return motor_target(now_ns, _ZERO, _ZERO, _ZERO, _ZERO, _ZERO, DAMP_DAMPING)


@dataclass(frozen=True, slots=True)
class Hold:
    """A posture to hold after the commands have stopped; a raised foot is put down first.

    On one leg the robot would not withstand a push, and a silence in mid-swing can leave it tipping
    already. The motion is planned once, from measured joints and foot forces alone.

    Attributes:
        start_ns: robot time of the beginning [ns].
        end_ns: robot time after which :meth:`target` is always the same [ns].
        begin: (27,) posture at the beginning [rad].
        change: (27,) of the posture until the end; zero but in the leg of a raised foot [rad].
        velocity: (27,) at the beginning; zero but in that leg [rad/s].
        torque: (27,) feed-forward; it goes on carrying the weight [N·m].
    """

    start_ns: int
    end_ns: int
    begin: Array
    change: Array
    velocity: Array
    torque: Array

    def target(self, now_ns: int) -> Target:
        """Return the target at robot time ``now_ns`` [ns]."""
        # A cubic that begins with the measured velocity and ends at rest.
        duration = LOWERING_NS * 1e-9
        s = min(max((now_ns - self.start_ns) / LOWERING_NS, 0.0), 1.0)
        drift = duration * self.velocity
        moved = s * s * (3.0 - 2.0 * s) * self.change + s * (1.0 - s) ** 2 * drift
        rate = (1.0 - s) * (6.0 * s * self.change + (1.0 - 3.0 * s) * drift) / duration
        return hold_target(now_ns, self.begin + moved, self.torque, rate)

    def landed(self, now_ns: int, position: Array, foot_force: Array) -> "Hold":
        """Return how to go on: as planned, or with the foot at rest once both feet carry.

        A foot that lands early, as of a robot that tips towards it, would push it back and over.

        Args:
            now_ns: robot time [ns].
            position: (27,) measured [rad].
            foot_force: (2,) normal force under the left and the right foot [N].
        """
        if now_ns >= self.end_ns or foot_force.min() < CARRYING:
            return self
        stopped = np.where(self.change == 0.0, self.begin, position)
        return replace(self, end_ns=now_ns, begin=stopped, change=_ZERO, velocity=_ZERO)


def plan_hold(
    now_ns: int, position: Array, velocity: Array, torque: Array, foot_force: Array
) -> Hold:
    """Return how to hold the robot from now on.

    Args:
        now_ns: robot time [ns].
        position: (27,) measured [rad].
        velocity: (27,) measured [rad/s].
        torque: (27,) feed-forward of the last command [N·m].
        foot_force: (2,) normal force under the left and the right foot [N].
    """
    change, drift, end_ns = np.zeros(NUM_JOINTS), np.zeros(NUM_JOINTS), now_ns
    raised = int(np.argmin(foot_force))
    if foot_force[raised] < CARRYING <= foot_force[1 - raised]:
        lowered = _lowered(raised, position)
        if lowered is not None:
            change = lowered - position
            drift[_LEGS[raised]] = velocity[_LEGS[raised]]
            end_ns += LOWERING_NS
    return Hold(now_ns, end_ns, position.copy(), change, drift, torque.copy())


def _lowered(raised: int, position: Array) -> Array | None:
    """Return ``position`` with the raised sole put straight down into the plane of the other one.

    None if it is not near that plane as in a step, or if the leg does not reach it.
    """
    side, other = _SIDES[raised], _SIDES[1 - raised]
    ground = foot_in_body(other, position)
    foot = ground.local_pose(foot_in_body(side, position))
    x, y, height = foot.position
    flat = Pose.upright(x, y, 0.0, foot.yaw)
    goal = Pose(ground.apply(flat.position), multiply(ground.quaternion, flat.quaternion))
    lowered = leg_reaching(side, goal, position)
    missed = float(np.linalg.norm(foot_in_body(side, lowered).position - goal.position))
    return lowered if abs(height) < HIGHEST and missed < REACHED else None
