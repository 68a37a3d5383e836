"""Maps each topic to what is exported of it.

Every message is written field by field under its own topic, except images and journals. What
viewers can draw is written once more in the form they draw:

| from | topic | as | with ``ros2`` |
|---|---|---|---|
| plant/state, wbc/command | /joints/measured, /joints/commanded | sensor_msgs/msg/JointState | |
| camera/<eye> | /camera/<eye> | sensor_msgs/msg/CompressedImage | .../image_raw/compressed |
| camera/<eye> | /camera/<eye>/camera_info | sensor_msgs/msg/CameraInfo | |
| plant/state, plant/truth | /base/measured, /base/truth | foxglove.PoseInFrame in world | [1] |
| teleop/setpoint | /hands/<side>/setpoint | foxglove.PoseInFrame in torso_link | [1] |
| wbc/target | /hands/<side>/target | foxglove.PoseInFrame in torso_link | [1] |
| plant/state, 50 Hz | /tf, /hands/<side>/measured | foxglove.FrameTransforms, pose | [2], [1] |
| plant/state | /robot (once): the shapes | foxglove.SceneUpdate | none |
| task/scene | /scene: objects, marks | foxglove.FrameTransforms in world | [2] in /tf |
| health | /links/<service>/<topic> | trill.LinkPlot: ages, stages, injected delay | none |
| requests, replies, marks, stops | /events | foxglove.Log | rcl_interfaces/msg/Log in /rosout |

[1] geometry_msgs/msg/PoseStamped, [2] tf2_msgs/msg/TFMessage. With ``ros2`` there are these
messages only, and no fields, so that every ROS 2 tool can read all of the file.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from common import topics
from common.robot.frames import BODY_FRAME, HAND_FRAMES
from common.schemas import (
    CameraFrame,
    JointCommand,
    PlantState,
    SceneState,
    ServiceHealth,
    Setpoint,
)
from services.logger.export import ros, spatial
from services.logger.export.fields import to_protobuf
from services.logger.export.links import link_plot
from services.logger.export.robot import Frame, RobotModel
from services.logger.export.samples import Sample, protobuf_sample
from services.logger.read.events import EventLines
from services.logger.read.sender_clocks import Times

Array = NDArray[np.float64]

TRANSFORM_PERIOD_NS = 20_000_000
"""Robot time between transforms [ns]."""
NOT_EXPORTED: Mapping[str, str] = {
    topics.JOURNAL.name: "tables for replay, nothing a viewer could draw"
}
"""Topics that are not exported, with the reason."""

Convert = Callable[[str, Any, Times], Iterator[Sample]]
"""Converts a message, given its topic's name and its times, to the samples to write."""


class _Forms(Protocol):
    """What poses, transforms and events are written as: one of two modules."""

    def pose_in_frame(
        self, topic: str, stamp: int, frame: str, position: Array, quaternion: Array
    ) -> Sample: ...

    def frame_transforms(self, topic: str, stamp: int, frames: Iterable[Frame]) -> Sample: ...

    def log_line(
        self, topic: str, stamp: int, name: str, text: str, *, warning: bool
    ) -> Sample: ...


class Routes:
    """Converts the messages of one log, in order."""

    def __init__(self, robot: RobotModel | None, *, ros2: bool = False) -> None:
        """Without a ``robot`` model, leave out link transforms, shapes, lenses, measured hands.

        With ``ros2`` write messages of ROS 2 only.
        """
        self._robot = robot
        self._ros2 = ros2
        self._forms: _Forms = ros if ros2 else spatial
        self._last_transform: int | None = None
        self._shapes_due = robot is not None and not ros2
        self._events = EventLines()
        self._table: dict[str, tuple[Convert, ...]] = {
            topics.PLANT_STATE.name: (_measured_joints, self._body),
            topics.PLANT_TRUTH.name: (self._true_base,),
            topics.WBC_COMMAND.name: (_commanded_joints,),
            topics.TELEOP_SETPOINT.name: (self._setpoints,),
            topics.WBC_TARGET.name: (self._setpoints,),
            topics.CAMERA_LEFT.name: (self._image,),
            topics.CAMERA_RIGHT.name: (self._image,),
            topics.HEALTH.name: () if ros2 else (_links,),
            topics.TASK_SCENE.name: (self._scene,),
        }
        self._others: tuple[Convert, ...] = (self._event,)

    def __call__(self, topic: str, name: str, message: Any, times: Times) -> Iterator[Sample]:
        """Yield the samples to write for a message of ``topic``, the row of the topic table.

        ``name`` is its key without the robot: the topic, and the source if each has its own key.

        Raises:
            ExportError: the message cannot be converted.
        """
        if not self._ros2 and not isinstance(message, CameraFrame):
            yield protobuf_sample(f"/{name}", to_protobuf(message))
        for convert in self._table.get(topic, self._others):
            yield from convert(name, message, times)

    def _body(self, _: str, state: PlantState, times: Times) -> Iterator[Sample]:
        """Yield the base's pose at every state, and the links' transforms less often."""
        position, quaternion = state.base_position, state.base_quaternion
        yield self._forms.pose_in_frame(
            "/base/measured", times.stamp, spatial.WORLD_FRAME, position, quaternion
        )
        if not self._due(state.header.stamp):
            return
        self._last_transform = state.header.stamp
        frames = [Frame(BODY_FRAME, spatial.WORLD_FRAME, position, quaternion)]
        robot = self._robot
        if robot is not None:
            robot.place(state.joint_position, state.gripper_closure)
            frames += robot.frames()
            if self._shapes_due:
                self._shapes_due = False
                yield spatial.robot_scene("/robot", times.stamp, robot.meshes())
            for side, site in HAND_FRAMES.items():
                yield self._forms.pose_in_frame(
                    f"/hands/{side}/measured", times.stamp, BODY_FRAME, *robot.in_body(site)
                )
        yield self._forms.frame_transforms("/tf", times.stamp, frames)

    def _due(self, stamp: int) -> bool:
        last = self._last_transform
        # Robot time may start again, when the robot's side does.
        return last is None or not last <= stamp < last + TRANSFORM_PERIOD_NS

    def _true_base(self, _: str, state: PlantState, times: Times) -> Iterator[Sample]:
        yield self._forms.pose_in_frame(
            "/base/truth",
            times.stamp,
            spatial.WORLD_FRAME,
            state.base_position,
            state.base_quaternion,
        )

    def _setpoints(self, name: str, setpoint: Setpoint, times: Times) -> Iterator[Sample]:
        # What an operator asks for, and what the controller makes of it at present.
        what = "target" if name == topics.WBC_TARGET.name else "setpoint"
        for side in HAND_FRAMES:
            yield self._forms.pose_in_frame(
                f"/hands/{side}/{what}",
                times.stamp,
                BODY_FRAME,
                getattr(setpoint, f"{side}_hand_position_in_body"),
                getattr(setpoint, f"{side}_hand_quaternion_in_body"),
            )

    def _image(self, name: str, frame: CameraFrame, times: Times) -> Iterator[Sample]:
        # As ROS 2 names the topics of a camera, so that its tools find one by the other.
        topic = f"/{name}/image_raw/compressed" if self._ros2 else f"/{name}"
        yield ros.compressed_image(topic, times.stamp, frame)
        if self._robot is not None:
            lens = self._robot.lens(frame.eye)
            yield ros.camera_info(f"/{name}/camera_info", times.stamp, frame, lens)

    def _scene(self, _: str, scene: SceneState, times: Times) -> Iterator[Sample]:
        frames = [
            Frame(f"scene/{one.name}", spatial.WORLD_FRAME, one.position, one.quaternion)
            for one in (*scene.objects, *scene.marks)
        ]
        topic = "/tf" if self._ros2 else "/scene"
        yield self._forms.frame_transforms(topic, times.stamp, frames)

    def _event(self, name: str, message: Any, times: Times) -> Iterator[Sample]:
        text, warning = self._events.line(message)
        if text:
            topic = "/rosout" if self._ros2 else "/events"
            yield self._forms.log_line(topic, times.stamp, name, text, warning=warning)


def _measured_joints(_: str, state: PlantState, times: Times) -> Iterator[Sample]:
    yield ros.joint_state(
        "/joints/measured",
        times.stamp,
        state.joint_position,
        state.joint_velocity,
        state.joint_torque,
    )


def _commanded_joints(_: str, command: JointCommand, times: Times) -> Iterator[Sample]:
    yield ros.joint_state(
        "/joints/commanded", times.stamp, command.position, command.velocity, command.torque
    )


def _links(_: str, health: ServiceHealth, times: Times) -> Iterator[Sample]:
    for link in health.links:
        topic = f"/links/{health.service}/{link.topic}"
        yield protobuf_sample(topic, to_protobuf(link_plot(link)))
