"""Turns the ground truth into numbers that describe the scene to a policy.

A policy that is told the scene shows what it can do when nothing has to be seen; training an
encoder of pictures needs the same numbers as labels. Training and service share these functions.

An object or mark gives five numbers, in the body frame: ``lever_grip.x``, ``.y``, ``.z`` [m],
``.sin_yaw`` and ``.cos_yaw`` [1]. A hinge or slide gives one, called as the joint [rad or m].
"""

from collections.abc import Sequence
from math import cos, sin

import numpy as np

from common.episodes.errors import EpisodeError
from common.robot.pose import Pose
from common.schemas import PlantState, SceneState
from common.schemas.arrays import Float64Array as Array

POSE_PARTS = ("x", "y", "z", "sin_yaw", "cos_yaw")
"""Numbers of an object or mark."""


def oracle_names(scene: SceneState) -> tuple[str, ...]:
    """Return the names of all numbers that a scene has: objects, marks, joints."""
    placed = (pose.name for pose in (*scene.objects, *scene.marks))
    return (
        *(f"{name}.{part}" for name in placed for part in POSE_PARTS),
        *(joint.name for joint in scene.joints),
    )


def oracle_numbers(names: Sequence[str], state: PlantState, scene: SceneState) -> Array:
    """Return the numbers (n,) called ``names``, objects and marks in the body frame.

    Args:
        names: some of :func:`oracle_names`, in any order.
        state: ground truth of the robot.
        scene: ground truth of the scene at the same time.

    Raises:
        EpisodeError: the scene has no such number.
    """
    body = Pose(state.base_position, state.base_quaternion)
    found = {joint.name: joint.position for joint in scene.joints}
    wanted = {name.rpartition(".")[0] for name in names}
    for placed in (*scene.objects, *scene.marks):
        if placed.name in wanted:
            pose = body.local_pose(Pose(placed.position, placed.quaternion))
            numbers = (*pose.position.tolist(), sin(pose.yaw), cos(pose.yaw))
            found |= {
                f"{placed.name}.{part}": number
                for part, number in zip(POSE_PARTS, numbers, strict=True)
            }
    if missing := [name for name in names if name not in found]:
        raise EpisodeError(
            f"expected the scene {scene.scene!r} of the task {scene.task!r} to have "
            f"{', '.join(missing)}, it has {', '.join(oracle_names(scene)) or 'nothing'}; run the "
            "task that the policy was trained for"
        )
    return np.array([found[name] for name in names])
