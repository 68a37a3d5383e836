"""Trials of a task in the physics: start, snapshots for the judge, and status messages."""

from collections.abc import Callable, Mapping
from typing import Any

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
from services.sim.errors import TaskError
from services.sim.model.contacts import foot_normal_forces
from services.sim.model.world import Addresses
from services.sim.tasks.base import BodyState, Snapshot, Task
from services.sim.tasks.contacts import ContactSensor
from services.sim.tasks.judge import Judge

TICK_STEPS = 10
"""Physics steps between two snapshots for the judge."""
_START_STREAM = 0x7A5C
"""Separates the random numbers of the start from those of the sensor noise."""


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
        self._torso = addresses.torso
        names = task.objects if task else ()
        self._objects = {name: _locate(model, data, name) for name in names}
        bodies = {model.body(i).name for i in range(model.nbody)}
        self._bodies = {name: read for name, read in self._objects.items() if name in bodies}
        joints = task.joints if task else ()
        self._joints = {name: int(model.joint(name).qposadr[0]) for name in joints}

    @property
    def moves(self) -> bool:
        """Whether the scene has joints."""
        return bool(self._qpos.size)

    def robot(self) -> BodyState:
        """Return the state of the torso."""
        qpos, qvel = self._data.qpos, self._data.qvel
        return BodyState(qpos[:3].copy(), qpos[3:7].copy(), float(np.linalg.norm(qvel[:3])))

    def objects(self) -> dict[str, BodyState]:
        """Return the states of the watched bodies and sites."""
        return {name: read() for name, read in self._objects.items()}

    def bodies(self) -> dict[str, BodyState]:
        """Return the states of the watched bodies, by which a trial is judged."""
        return {name: read() for name, read in self._bodies.items()}

    def joints(self) -> dict[str, float]:
        """Return the positions of the watched hinges and slides [rad, m]."""
        return {name: float(self._data.qpos[at]) for name, at in self._joints.items()}

    def state(self, stamp_ns: int, reset_count: int) -> SceneState:
        """Return the message about the scene as it is now."""
        task = self._task
        return SceneState(
            header=Header(stamp=stamp_ns),
            scene=self._scene,
            task=task.name if task else "",
            objects=_poses(self.objects()),
            joints=[SceneJoint(name=n, position=v) for n, v in self.joints().items()],
            marks=_poses(task.marks) if task else [],
            qpos=self._qpos.tolist(),
            reset_count=reset_count,
        )


def _poses(poses: Mapping[str, Pose]) -> list[ScenePose]:
    return [
        ScenePose(name=name, position=pose.position, quaternion=pose.quaternion)
        for name, pose in poses.items()
    ]


def _locate(model: Any, data: Any, name: str) -> Callable[[], BodyState]:
    """Return a function that reads the state of the body or site ``name``."""
    velocity = np.zeros(6)
    body = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY.value, name)
    site = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_SITE.value, name)
    if body >= 0:

        def read_body() -> BodyState:
            kind = mujoco.mjtObj.mjOBJ_XBODY.value
            mujoco.mj_objectVelocity(model, data, kind, body, velocity, 0)
            speed = float(np.linalg.norm(velocity[3:]))
            return BodyState(data.xpos[body].copy(), data.xquat[body].copy(), speed)

        return read_body
    if site >= 0:

        def read_site() -> BodyState:
            quaternion = np.zeros(4)
            mujoco.mju_mat2Quat(quaternion, data.site_xmat[site])
            return BodyState(data.site_xpos[site].copy(), quaternion)

        return read_site
    raise TaskError(f"expected a body or site called {name!r} in the task's scene, there is none")


class Trial:
    """Runs a task's trials, one after another, in a plant's physics.

    Attributes:
        task: the task.
        view: reads the scene.
        judge: of the trial in progress.
        seed: of the start of the trial in progress.
    """

    def __init__(self, task: Task, model: Any, data: Any, addresses: Addresses) -> None:
        self.task = task
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
        start = self.task.start(np.random.default_rng((seed, _START_STREAM)))
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
        left, right = foot_normal_forces(self._data, self._addresses.feet).tolist()
        return Snapshot(
            time=time,
            robot=self.view.robot(),
            loads=(left, right),
            fallen=fallen,
            joints=self.view.joints(),
            objects=self.view.bodies(),
            contacts=self._contacts.read(),
        )

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
