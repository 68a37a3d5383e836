"""Print the time of one tick of a controller of placo, a C++ library, with tasks like this one's.

    PLACO_PYTHON benchmarks/workloads/placo_tick.py MODEL.xml STATES.npz

Needs placo 0.10.2 and numpy alone, in an interpreter of its own: it brings another pinocchio. At
each state that ``tick.py`` wrote, it updates the model and solves one inverse dynamics QP with
tasks for CoM, torso, both hands relative to the torso, both feet and the posture, coupled knees,
and planar contacts with friction for the feet that carry; no limits of torques or accelerations.
Only these two calls are timed, no Python, and one tick follows the other with warm caches.
Results: ``median_ms`` and ``p99_ms``, CPU time.
"""

import argparse
import contextlib
import gc
import json
import os
import tempfile
import xml.etree.ElementTree as ET
from pathlib import Path
from time import thread_time
from typing import Any

import numpy as np
import placo

CARRIES = 20.0
"""A foot with this normal force is a contact [N]."""
WARM_UP = 20
SIDES = ("l", "r")
TORSO = "torso_link"
UPPER_BODY = ("shoulder", "elbow", "wrist", "neck")
"""Parts of the names of the joints with a posture."""
FRICTION = 0.3
SOLE = (0.23, 0.13)
"""Length and width of the support rectangle [m]."""


def load(mjcf: Path) -> Any:
    """Return the robot with locked fingers."""
    tree = ET.parse(mjcf)
    root = tree.getroot()
    for section in ("equality", "tendon", "actuator", "contact"):
        for element in root.findall(section):
            root.remove(element)
    for body in root.iter("body"):
        for joint in [j for j in body.findall("joint") if "finger" in j.get("name", "")]:
            body.remove(joint)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "robot.xml")
        tree.write(path)
        with _silent():
            return placo.RobotWrapper(str(path), placo.Flags.mjcf + placo.Flags.ignore_collisions)


@contextlib.contextmanager
def _silent() -> Any:
    """Keep what C++ prints off standard output."""
    kept = os.dup(1)
    null = os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(null)


class PlacoController:
    """Follows the motion of the states that it is given."""

    def __init__(self, robot: Any, q: Any) -> None:
        self.robot = robot
        robot.state.q = q
        robot.update_kinematics()
        self.solver = solver = placo.DynamicsSolver(robot)
        self.com = solver.add_com_task(robot.com_world())
        self.com.configure("com", "soft", 20.0)
        self.torso = solver.add_orientation_task(TORSO, robot.get_T_world_frame(TORSO)[:3, :3])
        self.torso.configure("torso", "soft", 40.0)
        self.feet, self.contacts = [], []
        for side in SIDES:
            hand = robot.get_T_a_b(TORSO, f"{side}_hand")
            task = solver.add_relative_frame_task(TORSO, f"{side}_hand", hand)
            task.configure(f"{side}_hand", "soft", 20.0, 10.0)
            sole = f"{side}_foot"
            foot = solver.add_frame_task(sole, robot.get_T_world_frame(sole))
            foot.configure(sole, "soft", 60.0, 60.0)
            contact = solver.add_planar_contact(foot)
            contact.length, contact.width = SOLE
            contact.mu = FRICTION
            knee = (
                solver.add_gear_task()
            )  # one for each: a second gear of a task replaces the first
            knee.set_gear(f"{side}_knee_fe_jd", f"{side}_knee_fe_jp", 1.0)
            knee.configure(f"{side}_knee", "hard", 1.0)
            self.feet.append(foot)
            self.contacts.append(contact)
        posture = solver.add_joints_task()
        free = [name for name in robot.joint_names() if any(part in name for part in UPPER_BODY)]
        posture.set_joints({name: robot.get_joint(name) for name in free})
        posture.configure("posture", "soft", 0.02)

    def follow(self, q: Any, v: Any, carries: list[bool]) -> None:
        """Set a state, with where CoM, torso and feet were at the last one as the targets."""
        robot = self.robot
        self.com.target_world = robot.com_world()
        self.torso.R_world_frame = robot.get_T_world_frame(TORSO)[:3, :3]
        for side, foot, contact, active in zip(
            SIDES, self.feet, self.contacts, carries, strict=True
        ):
            foot.T_world_frame = robot.get_T_world_frame(f"{side}_foot")
            contact.active = active
        robot.state.q, robot.state.qd = q, v

    def tick(self) -> Any:
        """Return the solution; nothing but C++."""
        self.robot.update_kinematics()
        return self.solver.solve(False)


def matrix(quaternion: Any) -> Any:
    """Return the rotation matrix (3, 3) of a unit quaternion (w, x, y, z)."""
    w, x, y, z = quaternion
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    return np.eye(3) + 2.0 * (w * cross + cross @ cross)


def main() -> int:
    """Tick and print the result."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("model", type=Path)
    parser.add_argument("states", type=Path)
    arguments = parser.parse_args()
    states = np.load(arguments.states)
    robot = load(arguments.model)
    turn = states["base_quaternion"]
    q = np.hstack((states["base_position"], turn[:, 1:], turn[:, :1], states["joint_position"]))
    linear = np.array(
        [matrix(t).T @ v for t, v in zip(turn, states["base_linear_velocity"], strict=True)]
    )
    v = np.hstack((linear, states["base_angular_velocity"], states["joint_velocity"]))
    controller = PlacoController(robot, q[0])
    gc.disable()
    seconds, failed = [], 0
    carries = (states["foot_normal_force"] > CARRIES).tolist()
    for index in range(len(q)):
        controller.follow(q[index], v[index], carries[index])
        began = thread_time()
        result = controller.tick()
        seconds.append(thread_time() - began)
        failed += not result.success
    if failed:
        raise RuntimeError(f"expected every QP to be solved, {failed} of {len(q)} were not")
    median, p99 = 1e3 * np.percentile(seconds[WARM_UP:], (50.0, 99.0))
    print(json.dumps({"median_ms": median, "p99_ms": p99}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
