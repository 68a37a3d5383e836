"""bench/hammer: grip the hammer, lift it off, side-step to the trolley and lay it down."""

import numpy as np

from common.robot.pose import Pose
from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.observation import Observation, hand_pose
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError
from services.teleop.targets.hand import hand_quaternion

SIDE = "right"
BELOW_GRIP = 0.1325
"""Distance from the gripped point down to the end of the handle [m]."""
FURTHEST = 0.49
"""Largest x that a hand reaches in the body frame [m]."""
TRAY_X = 0.13
"""Distance behind the tray's near rim at which to put the hammer [m]."""


def hammer(operator: OperatorModel) -> Act:
    """Bring the hammer to the tray."""
    operator.note = "looking at the hammer"
    operator.gaze = 0.3
    yield from operator.react()
    yield from operator.engage("left", "right")
    for _ in range(3):
        yield from take(operator)
        if lifted(operator.seen):
            break
    else:
        raise StrategyError("the hammer did not come off the hanger in three attempts")
    yield from carry(operator)
    yield from put_down(operator)
    operator.note = "done"
    return True


def lifted(seen: Observation) -> bool:
    """Return whether the hammer is in the hand."""
    off = seen.pose_of("hammer_grip").position - seen.hand_in_world(SIDE)
    return float(np.linalg.norm(off)) < 0.05


def facing(seen: Observation, point: Array, pitch: float = 0.0, roll: float = 0.0) -> Pose:
    """Return the hand at a point (3,) of the world, pointing along world x, in the body frame."""
    yaw = -seen.torso.yaw
    return Pose(seen.torso.local(point), hand_quaternion(roll, pitch, yaw))


def take(operator: OperatorModel) -> Act:
    """Grasp the handle, lift the hammer and draw it back."""
    before = operator.vary(0.16, 0.015)
    height = operator.vary(0.0, 0.008)
    lift, back = operator.vary(0.045, 0.004), operator.vary(0.13, 0.01)

    def at(seen: Observation, ahead: float) -> Pose:
        grip = seen.pose_of("hammer_grip").position
        return facing(seen, grip + np.array([ahead, 0.0, height]))

    operator.note = "to the hammer"
    yield from operator.grasp(SIDE, at, before)
    yield from operator.pause(abs(operator.vary(0.15, 0.1)))
    operator.note = "lifting"
    yield from shift(operator, (0.0, 0.0, lift), 0.7)
    yield from shift(operator, (-back, 0.0, 0.0), 0.8)
    return True


def shift(operator: OperatorModel, by: tuple[float, float, float], speed: float = 1.0) -> Act:
    """Move the hand along the world's axes from where it is seen."""
    here = operator.seen.hand_in_world(SIDE) + np.array(by)
    held = operator.seen.hands[SIDE].quaternion
    yield from operator.reach(
        SIDE,
        lambda seen: Pose(seen.torso.local(here), held),
        speed=speed,
        tolerance=0.025,
        corrections=2,
    )
    return True


def carry(operator: OperatorModel) -> Act:
    """Hold the hammer low, clear of the hanger while the torso sways, and side-step to the tray."""
    x, y, z = operator.vary(0.305, 0.006), operator.vary(-0.22, 0.008), operator.vary(0.04, 0.005)
    operator.note = "carrying"
    yield from operator.reach(SIDE, lambda _: hand_pose(x, y, z), tolerance=0.025)
    steps = 0
    while steps < 9:
        torso, tray = operator.seen.torso, operator.seen.pose_of("cart_tray")
        aside = torso.position[1] + y - tray.position[1]
        if aside < 0.07:
            break
        yield from operator.gait(Gait.SIDE_RIGHT)
        yield from operator.react()
        steps += 1
    high = hand_pose(operator.vary(0.335, 0.006), y, operator.vary(0.12, 0.004))
    yield from operator.reach(SIDE, lambda _: high, tolerance=0.025)
    return True


def put_down(operator: OperatorModel) -> Act:
    """Lower the hammer over the tray, leaning it away, let go and draw back."""
    tray = operator.seen.pose_of("cart_tray").position
    inside, lean = operator.vary(TRAY_X, 0.01), operator.vary(0.45, 0.05)
    near = tray[0] - 0.28 + inside

    def over(seen: Observation, height: float, pitch: float) -> Pose:
        y = float(np.clip(seen.hand_in_world(SIDE)[1], tray[1] - 0.14, tray[1] + 0.14))
        pose = facing(seen, np.array([near, y, tray[2] + height]), pitch)
        return Pose(np.minimum(pose.position, (FURTHEST, np.inf, np.inf)), pose.quaternion)

    operator.note = "putting down"
    yield from operator.reach(
        SIDE, lambda s: over(s, BELOW_GRIP + 0.075, 0.0), speed=0.9, tolerance=0.025
    )
    yield from operator.reach(
        SIDE, lambda s: over(s, BELOW_GRIP + 0.03, lean), speed=0.7, tolerance=0.025, angle=0.2
    )
    yield from operator.react()
    yield from operator.grip(SIDE, 0.0)
    operator.note = "drawing back"
    yield from shift(operator, (-0.18, 0.0, 0.03), 0.9)
    return True
