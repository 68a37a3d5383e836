"""The Door environment: walk to the door, unlock it, push it open and walk through."""

from services.sim.tasks.base import Pose, Snapshot, flat_pose

OBJECTS = ("leaf", "lever", "lever_grip")
JOINTS = ("door_hinge", "door_lever", "door_latch")
PUBLIC_GOAL = (0.1, 0.0)
"""Where the public TRILL simulation wants the robot to stand before the door (x, y) [m]."""


def door_marks(x: float, y: float) -> dict[str, Pose]:
    """The goal of the torso's ground point."""
    return {"goal": flat_pose(x, y)}


def hinge(snapshot: Snapshot) -> float:
    """How far the leaf is open [rad]."""
    return snapshot.joints["door_hinge"]
