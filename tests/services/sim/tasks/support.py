"""A workshop without motors: the robot stands nailed to its place, things are moved by hand."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import mujoco
import numpy as np
from numpy.typing import NDArray

from common.robot.frames import HAND_FRAMES
from common.robot.joints import FINGER_JOINTS
from common.schemas import TaskVerdict
from services.sim.model.world import build_model, find_addresses
from services.sim.physics.stance import standing_qpos
from services.sim.tasks import find_task
from services.sim.tasks.base import BodyState, Contact, Snapshot
from services.sim.tasks.trial import Trial

Array = NDArray[np.float64]


class Workshop:
    """A scene's physics with an immovable robot that can still be touched."""

    def __init__(self, scene: str, task: str = "", seed: int = 0) -> None:
        self.model = build_model(scene, visuals=False)
        self.data = mujoco.MjData(self.model)
        self.addresses = find_addresses(self.model)
        self.data.qpos[:] = standing_qpos(self.model, self.addresses, 0.70, 0.28)
        self.trial: Trial | None = None
        # As deep in the floor as its weight presses it: nailed feet bear load.
        self.data.qpos[2] -= 2e-4
        if task:
            self.trial = Trial(find_task(task), self.model, self.data, self.addresses)
            self.trial.restart(seed)
        else:
            self.data.qpos[0] = -5.0
        self._robot = self.data.qpos[: self.addresses.scene].copy()
        self._dofs = self.model.nv - sum(
            {0: 6, 1: 3, 2: 1, 3: 1}[int(self.model.joint(i).type[0])]
            for i in range(self.model.njnt)
            if self.model.joint(i).qposadr[0] >= self.addresses.scene
        )
        self.fallen = False
        self.time = 0.0
        mujoco.mj_forward(self.model, self.data)

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> float:
        """Let physics go on; returns after how long ``until`` came true, or the whole time."""
        for i in range(round(seconds * 1000)):
            mujoco.mj_step(self.model, self.data)
            self.nail()
            self.time += 1e-3
            if self.trial is not None:
                self.trial.step(self.time, fallen=self.fallen)
            if until():
                return i * 1e-3
        return seconds

    def nail(self) -> None:
        self.data.qpos[: self.addresses.scene] = self._robot
        self.data.qvel[: self._dofs] = 0.0

    def place_robot(self, x: float, y: float, yaw: float = 0.0) -> None:
        self._robot[:2] = x, y
        self._robot[3:7] = np.cos(0.5 * yaw), 0.0, 0.0, np.sin(0.5 * yaw)
        self.nail()
        mujoco.mj_forward(self.model, self.data)

    def close_hand(self, side: str, opening: float) -> None:
        """Put the fingers of ``side`` half of ``opening`` [m] from the middle each."""
        for name in FINGER_JOINTS[side]:
            self._robot[self.model.joint(name).qposadr[0]] = 0.5 * opening
        self.nail()
        mujoco.mj_forward(self.model, self.data)

    def hand(self, side: str) -> Array:
        """(3,) where the fingers' pads are [m]."""
        return np.array(self.data.site(HAND_FRAMES[side]).xpos)

    def set(self, joint: str, *values: float) -> None:
        """Put a joint of the scene somewhere, at rest."""
        self.data.joint(joint).qpos[:] = values
        self.data.joint(joint).qvel[:] = 0.0
        mujoco.mj_forward(self.model, self.data)

    def put(self, joint: str, position: Array) -> None:
        """Put a free thing somewhere, upright and at rest."""
        self.set(joint, *position, 1.0, 0.0, 0.0, 0.0)

    def torque(self, joint: str, value: float) -> None:
        """Push a hinge or slide from now on [N·m, N]."""
        self.data.joint(joint).qfrc_applied[:] = value

    def pull(self, body: str, force: tuple[float, float, float]) -> None:
        """Pull at a body's centre of mass from now on [N]."""
        self.data.xfrc_applied[self.model.body(body).id, :3] = force

    def at(self, joint: str) -> float:
        return float(self.data.joint(joint).qpos[0])

    def where(self, body: str) -> Array:
        return np.array(self.data.body(body).xpos)

    @property
    def verdict(self) -> TaskVerdict:
        assert self.trial is not None
        return self.trial.judge.verdict

    @property
    def reason(self) -> str:
        assert self.trial is not None
        return self.trial.judge.reason

    @property
    def undesired(self) -> list[str]:
        assert self.trial is not None
        return [str(contact) for contact in self.trial.judge.undesired]


@dataclass
class Measured:
    """Measures what it is told."""

    _robot: BodyState
    _loads: tuple[float, float]
    _joints: Mapping[str, float]
    _objects: Mapping[str, BodyState]

    def robot(self) -> BodyState:
        return self._robot

    def loads(self) -> tuple[float, float]:
        return self._loads

    def joints(self) -> Mapping[str, float]:
        return self._joints

    def objects(self) -> Mapping[str, BodyState]:
        return self._objects


def snapshot(
    time: float,
    robot: BodyState | None = None,
    contacts: Mapping[Contact, float] | None = None,
    *,
    loads: tuple[float, float] = (180.0, 180.0),
    fallen: bool = False,
    joints: Mapping[str, float] | None = None,
    objects: Mapping[str, BodyState] | None = None,
) -> Snapshot:
    """A robot that stands at the origin, unless told otherwise."""
    measured = Measured(
        robot or BodyState.upright(0.0, 0.0, 0.82), loads, joints or {}, objects or {}
    )
    return Snapshot(time, fallen, contacts or {}, measured)
