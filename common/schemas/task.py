"""Progress of a scored task, and the objects of its scene."""

from enum import IntEnum

from pydantic import BaseModel, ConfigDict, Field

from common.schemas.arrays import Quaternion, Vector3
from common.schemas.base import Message


class _Part(BaseModel):
    model_config = ConfigDict(
        frozen=True, extra="forbid", arbitrary_types_allowed=True, allow_inf_nan=False
    )


class TaskVerdict(IntEnum):
    """Verdict on a trial; all but RUNNING are final until the plant is reset."""

    RUNNING = 0
    SUCCESS = 1
    """The goal was reached within the time, without a fall or an undesired contact."""
    PARTIAL = 2
    """The goal was reached with an undesired contact, or only part of the task was done in time."""
    FAILURE = 3
    """The robot fell, the task can no longer be done, or no part of it was done in time."""


class TaskStage(_Part):
    """One step towards a task's goal; the last one is the goal."""

    name: str = Field(max_length=80)
    done: bool


class UndesiredContact(_Part):
    """A contact that the task forbids."""

    name: str = Field(max_length=80, description="for instance: left wrist on jamb")
    since: float = Field(ge=0.0, description="time of the first touch in the trial [s]")
    peak: float = Field(ge=0.0, description="largest normal force so far [N]")


class TaskStatus(Message):
    """Verdict and progress of the trial since the plant's last reset."""

    task: str = Field(max_length=80, description="for instance door/unlock")
    seed: int = Field(ge=0, description="of this trial's start")
    time: float = Field(ge=0.0, description="robot time since the start; the end's, once over [s]")
    limit: float = Field(gt=0.0, description="time limit [s]")
    verdict: TaskVerdict
    reason: str = Field(default="", max_length=400, description="why; empty while running")
    stages: list[TaskStage] = Field(default_factory=list, max_length=16)
    undesired: list[UndesiredContact] = Field(default_factory=list, max_length=64)
    reset_count: int = Field(default=0, ge=0, description="as in the plant's state")


class ScenePose(_Part):
    """Pose of an object or a mark."""

    name: str = Field(max_length=80)
    position: Vector3 = Field(description="in world [m]")
    quaternion: Quaternion = Field(description="to world rotation (w, x, y, z)")


class SceneJoint(_Part):
    """Position of a hinge or slide of the scene."""

    name: str = Field(max_length=80)
    position: float = Field(description="[rad] or [m]")


class SceneState(Message):
    """Ground truth of the objects around the robot; published together with that of the robot.

    ``objects`` are the task's moving objects, ``marks`` places that do not move: the goal and other
    places the task names. ``qpos`` poses the scene in the model that plant and cameras share.
    """

    scene: str = Field(max_length=80)
    task: str = Field(default="", max_length=80)
    objects: list[ScenePose] = Field(default_factory=list, max_length=32)
    joints: list[SceneJoint] = Field(default_factory=list, max_length=32)
    marks: list[ScenePose] = Field(default_factory=list, max_length=16)
    qpos: list[float] = Field(
        default_factory=list, max_length=512, description="of the scene's joints, in model order"
    )
    reset_count: int = Field(default=0, ge=0, description="as in the plant's state")
