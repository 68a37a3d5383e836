"""Trials of a task in the physics: start, snapshots for the judge, and status messages."""

import math
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import mujoco
import numpy as np

from common.robot.pose import Pose
from common.schemas import (
    Header,
    SceneJoint,
    ScenePose,
    SceneState,
    TaskStage,
    TaskStatus,
    UndesiredContact,
)
from common.wire.builder import assembler
from services.sim.errors import TaskError
from services.sim.model.contacts import foot_normal_forces
from services.sim.model.world import Addresses
from services.sim.tasks.base import BodyState, Draw, Snapshot, Task
from services.sim.tasks.contacts import ContactSensor
from services.sim.tasks.judge import Judge

TICK_STEPS = 10
"""Physics steps between two snapshots for the judge."""
_START_STREAM = 0x7A5C
"""Separates the random numbers of the start from those of the sensor noise."""
# Not validated: the values are the model's own, and receivers check them.
_scene_state: Callable[[dict[str, Any]], SceneState] = assembler(SceneState)
_scene_pose: Callable[[dict[str, Any]], ScenePose] = assembler(ScenePose)
_scene_joint: Callable[[dict[str, Any]], SceneJoint] = assembler(SceneJoint)


class SceneView:
    """Reads the states of a scene's objects and joints.

    Without a task it reads the scene's ``qpos`` only.
    """

    def __init__(
        self, model: Any, data: Any, addresses: Addresses, scene: str, task: Task | None
    ) -> None:
        self._model, self._data = model, data
        self._scene, self._task = scene, task
        self._qpos = data.qpos[addresses.scene :]
        names = task.objects if task else ()
        self._objects = {name: _locate(model, data, name) for name in names}
        bodies = {model.body(i).name for i in range(model.nbody)}
        self._bodies = {name: at for name, at in self._objects.items() if name in bodies}
        joints = task.joints if task else ()
        self._joints = {name: int(model.joint(name).qposadr[0]) for name in joints}
        self._marks = _poses(task.marks) if task else []

    @property
    def moves(self) -> bool:
        """Whether the scene has joints."""
        return bool(self._qpos.size)

    def objects(self) -> dict[str, Pose]:
        """Return the poses of the watched bodies and sites."""
        return {name: place.pose() for name, place in self._objects.items()}

    def bodies(self) -> dict[str, BodyState]:
        """Return the states of the watched bodies, by which a trial is judged."""
        return {name: place.state() for name, place in self._bodies.items()}

    def joints(self) -> dict[str, float]:
        """Return the positions of the watched hinges and slides [rad, m]."""
        return {name: float(self._data.qpos[at]) for name, at in self._joints.items()}

    def state(self, stamp_ns: int, reset_count: int) -> SceneState:
        """Return the message about the scene as it is now."""
        task = self._task
        joints = self.joints().items()
        return _scene_state(
            {
                "header": Header(stamp=stamp_ns),
                "scene": self._scene,
                "task": task.name if task else "",
                "objects": _poses(self.objects()),
                "joints": [_scene_joint({"name": n, "position": v}) for n, v in joints],
                "marks": self._marks,
                "qpos": self._qpos.tolist(),
                "reset_count": reset_count,
            }
        )


def _poses(poses: Mapping[str, Pose]) -> list[ScenePose]:
    return [
        _scene_pose({"name": name, "position": pose.position, "quaternion": pose.quaternion})
        for name, pose in poses.items()
    ]


class _Place(NamedTuple):
    """Where a body or site is.

    Attributes:
        pose: returns its pose in the world.
        speed: returns the speed of its origin [m/s].
    """

    pose: Callable[[], Pose]
    speed: Callable[[], float]

    def state(self) -> BodyState:
        """Return its state."""
        pose = self.pose()
        return BodyState(pose.position, pose.quaternion, self.speed())


def _locate(model: Any, data: Any, name: str) -> _Place:
    """Find the body or site ``name``.

    Raises:
        TaskError: there is none.
    """
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY.value, name)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE.value, name)
    velocity = np.zeros(6)

    def speed() -> float:
        kind = mujoco.mjtObj.mjOBJ_XBODY.value
        mujoco.mj_objectVelocity(model, data, kind, body, velocity, 0)
        return math.hypot(*velocity[3:].tolist())

    if body >= 0:
        position, quaternion = data.xpos[body], data.xquat[body]
        return _Place(lambda: Pose(position.copy(), quaternion.copy()), speed)
    if site >= 0:
        origin, rotation = data.site_xpos[site], data.site_xmat[site]

        def pose() -> Pose:
            turned = np.zeros(4)
            mujoco.mju_mat2Quat(turned, rotation)
            return Pose(origin.copy(), turned)

        return _Place(pose, lambda: 0.0)
    raise TaskError(f"expected a body or site called {name!r} in the task's scene, there is none")


class Trial:
    """Runs a task's trials, one after another, in a plant's physics.

    It measures what the judge asks for: :class:`~services.sim.tasks.base.Measures`.

    Attributes:
        task: the task.
        view: reads the scene.
        judge: of the trial in progress.
        seed: of the start of the trial in progress.
    """

    def __init__(
        self, task: Task, model: Any, data: Any, addresses: Addresses, spread: float = 1.0
    ) -> None:
        """Begin the trial of seed 0; ``spread`` is a factor on what starts vary by."""
        self.task = task
        self._spread = spread
        self.view = SceneView(model, data, addresses, task.scene, task)
        self._data, self._addresses = data, addresses
        self._contacts = ContactSensor(model, data)
        self._joints = {
            model.joint(i).name: int(model.joint(i).qposadr[0]) for i in range(model.njnt)
        }
        self.restart(0)

    def restart(self, seed: int) -> None:
        """Begin a trial: place robot and objects at the start drawn with ``seed``."""
        self.seed = seed
        self.judge = Judge(self.task)
        self._contacts.read()
        self._steps = 0
        rng = np.random.default_rng((seed, _START_STREAM))
        start = self.task.start(Draw(rng, self._spread))
        qpos, half = self._data.qpos, 0.5 * start.yaw
        qpos[:2] = start.x, start.y
        qpos[3:7] = np.cos(half), 0.0, 0.0, np.sin(half)
        for name, values in start.joints.items():
            if name not in self._joints:
                raise TaskError(f"the start of {self.task.name} names {name!r}, not a joint")
            at = self._joints[name]
            qpos[at : at + len(values)] = values

    def step(self, time: float, *, fallen: bool) -> bool:
        """Collect contacts of the last physics step, and judge if it is time.

        Args:
            time: since the start of the trial [s].
            fallen: whether the robot has fallen.

        Returns:
            whether the judge's progress has changed.
        """
        self._steps += 1
        due = self._steps % TICK_STEPS == 0
        self._contacts.collect(between_objects=due)
        if not due:
            return False
        before = self.judge.progress
        self.judge.tick(self._snapshot(time, fallen=fallen))
        return self.judge.progress != before

    def _snapshot(self, time: float, *, fallen: bool) -> Snapshot:
        return Snapshot(time, fallen, self._contacts.read(), self)

    def robot(self) -> BodyState:
        """Return the state of the torso."""
        qpos, qvel = self._data.qpos, self._data.qvel
        return BodyState(qpos[:3].copy(), qpos[3:7].copy(), math.hypot(*qvel[:3].tolist()))

    def loads(self) -> tuple[float, float]:
        """Return the normal forces of the feet, left and right [N]."""
        left, right = foot_normal_forces(self._data, self._addresses.feet).tolist()
        return left, right

    def joints(self) -> dict[str, float]:
        """Return the positions of the watched hinges and slides [rad, m]."""
        return self.view.joints()

    def objects(self) -> dict[str, BodyState]:
        """Return the states of the watched bodies."""
        return self.view.bodies()

    def status(self, stamp_ns: int, reset_count: int) -> TaskStatus:
        """Return the message about verdict and progress."""
        judge = self.judge
        stages = [TaskStage(name=s.name, done=s.name in judge.done) for s in self.task.stages]
        return TaskStatus(
            header=Header(stamp=stamp_ns),
            task=self.task.name,
            seed=self.seed,
            time=judge.time,
            limit=self.task.limit,
            verdict=judge.verdict,
            reason=judge.reason,
            stages=stages,
            undesired=[
                UndesiredContact(name=str(contact), since=record.since, peak=record.peak)
                for contact, record in list(judge.undesired.items())[:64]
            ],
            reset_count=reset_count,
        )
