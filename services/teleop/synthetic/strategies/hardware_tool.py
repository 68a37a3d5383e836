"""hardware/tool: grip the tool, lift it, bring it over the box, put it down and let go."""

import numpy as np

from common.robot.pose import Pose
from common.schemas import Gait
from common.schemas.arrays import Float64Array as Array
from services.teleop.synthetic.observation import Observation, easy_yaw
from services.teleop.synthetic.operator_model import Act, OperatorModel, StrategyError
from services.teleop.targets.hand import hand_quaternion

SIDE = "right"
SOLE = 0.02
"""Height above the box's underside at which the tool is let go [m]."""


def tool_into_box(operator: OperatorModel) -> Act:
    """Bring the tool into the box, reaching across or side-stepping."""
    operator.note = "looking at the tool"
    operator.gaze = 0.75
    yield from operator.react()
    yield from operator.engage("left", "right")
    for _ in range(3):
        yield from take(operator)
        if held(operator.seen):
            break
    else:
        raise StrategyError("the tool was not lifted in three attempts")
    if operator.chance(0.4):
        yield from side_step(operator)
    yield from put_into_box(operator)
    operator.note = "done"
    return True


def held(seen: Observation) -> bool:
    """Return whether the tool is in the hand and off the table."""
    grip = seen.pose_of("tool_grip").position
    near = float(np.linalg.norm(grip - seen.hand_in_world(SIDE))) < 0.05
    return near and float(grip[2] - seen.pose_of("goal").position[2]) > 0.12


def pointing(seen: Observation, point: Array, yaw: float) -> Pose:
    """Return the level hand at a point (3,) of the world, with a heading in the body frame."""
    return Pose(seen.torso.local(point), hand_quaternion(0.0, 0.0, yaw))


def take(operator: OperatorModel) -> Act:
    """Grasp the handle and lift the tool."""
    before, height = operator.vary(0.13, 0.01), operator.vary(0.0, 0.006)
    lift, pitch = operator.vary(0.12, 0.008), operator.vary(0.15, 0.03)

    def at(seen: Observation, ahead: float) -> Pose:
        place = seen.torso.local(seen.pose_of("tool_grip").position)
        yaw = easy_yaw(SIDE, float(place[1]))
        along = np.array([np.cos(yaw), np.sin(yaw), 0.0])
        place = place + (ahead - 0.01) * along + np.array([0.0, 0.0, height])
        return Pose(place, hand_quaternion(0.0, pitch, yaw))

    operator.note = "to the tool"
    yield from operator.grasp(SIDE, at, before)
    operator.note = "lifting"
    here = operator.seen.hand_in_world(SIDE) + np.array([0.0, 0.0, lift])
    turned = operator.seen.hands[SIDE].quaternion
    yield from operator.reach(
        SIDE, lambda s: Pose(s.torso.local(here), turned), speed=0.7, tolerance=0.025
    )
    return True


def side_step(operator: OperatorModel) -> Act:
    """Carry the tool close and side-step until the box is before the hand."""
    operator.note = "carrying"
    hold = operator.seen.hands[SIDE]
    close = Pose(np.array([0.36, -0.24, hold.position[2]]), hold.quaternion)
    yield from operator.reach(SIDE, lambda _: close, speed=0.8, tolerance=0.03)
    for _ in range(3):
        box = operator.seen.in_body(operator.seen.pose_of("box"))
        if float(box.position[1]) < -0.15:
            break
        yield from operator.gait(Gait.SIDE_LEFT)
        yield from operator.react()
    return True


def put_into_box(operator: OperatorModel) -> Act:
    """Lower the tool into the box, let go and draw straight back."""
    aside, ahead = operator.vary(0.0, 0.006), operator.vary(0.0, 0.01)

    def over(seen: Observation, height: float) -> Pose:
        box, tool = seen.pose_of("box"), seen.pose_of("tool")
        grip = seen.hand_in_world(SIDE) - tool.position
        point = box.position + grip + np.array([ahead, aside, height])
        yaw = easy_yaw(SIDE, float(seen.torso.local(point)[1]))
        return pointing(seen, point, yaw)

    operator.note = "over the box"
    for corrections in (0, 2):
        # A rotation of the hand swings the tool, so the goal is computed again.
        yield from operator.reach(
            SIDE, lambda s: over(s, 0.115), speed=0.8, tolerance=0.02, corrections=corrections
        )
    operator.note = "putting down"
    yield from operator.reach(SIDE, lambda s: over(s, SOLE), speed=0.6, tolerance=0.015)
    yield from operator.react()
    yield from operator.grip(SIDE, 0.0)
    operator.note = "drawing back"
    yaw = easy_yaw(SIDE, float(operator.seen.hands[SIDE].position[1]))
    here = operator.seen.hands[SIDE]
    back = here.position - 0.15 * np.array([np.cos(yaw), np.sin(yaw), 0.0])
    yield from operator.reach(
        SIDE, lambda _: Pose(back, here.quaternion), speed=0.8, tolerance=0.05, corrections=0
    )
    return True
