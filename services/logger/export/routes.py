"""Maps each topic to what is exported of it.

Every message is written field by field under its own topic, except images and journals. What
viewers can draw is written once more in the form they draw:

| from | topic | as |
|---|---|---|
| plant/state, wbc/command | /joints/measured, /joints/commanded | sensor_msgs/msg/JointState |
| camera/left, camera/right | /camera/left, /camera/right | sensor_msgs/msg/CompressedImage |
| plant/state, plant/truth | /base/measured, /base/truth | foxglove.PoseInFrame in world |
| teleop/setpoint | /hands/<side>/setpoint | foxglove.PoseInFrame in torso_link |
| plant/state, 50 Hz | /tf, /hands/<side>/measured, /robot (once) | transforms, pose, shapes |
| task/scene | /scene: objects and marks as frames | foxglove.FrameTransforms in world |
| health | /links/<service>/<topic> | trill.LinkPlot: ages, stages, injected delay as numbers |
| requests, replies, marks | /events | foxglove.Log |
"""

from collections.abc import Callable, Iterator, Mapping
from typing import Any

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

TRANSFORM_PERIOD_NS = 20_000_000
"""Robot time between transforms [ns]."""
NOT_EXPORTED: Mapping[str, str] = {
    topics.JOURNAL.name: "tables for replay, nothing a viewer could draw"
}
"""Topics that are not exported, with the reason."""

Convert = Callable[[str, Any, Times], Iterator[Sample]]
"""Converts a message, given its topic's name and its times, to the samples to write."""


class Routes:
    """Converts the messages of one log, in order."""

    def __init__(self, robot: RobotModel | None) -> None:
        """Without a ``robot`` model, leave out link transforms, shapes and measured hands."""
        self._robot = robot
        self._last_transform: int | None = None
        self._events = EventLines()
        self._table: dict[str, tuple[Convert, ...]] = {
            topics.PLANT_STATE.name: (_fields, _measured_joints, self._body),
            topics.PLANT_TRUTH.name: (_fields, _true_base),
            topics.WBC_COMMAND.name: (_fields, _commanded_joints),
            topics.TELEOP_SETPOINT.name: (_fields, _setpoints),
            topics.CAMERA_LEFT.name: (_image,),
            topics.CAMERA_RIGHT.name: (_image,),
            topics.HEALTH.name: (_fields, _links),
            topics.TASK_SCENE.name: (_fields, _scene),
        }
        self._others = (_fields, self._event)

    def __call__(self, topic: str, name: str, message: Any, times: Times) -> Iterator[Sample]:
        """Yield the samples to write for a message of ``topic``, the row of the topic table.

        ``name`` is its key without the robot: the topic, and the source if each has its own key.

        Raises:
            ExportError: the message cannot be converted.
        """
        for convert in self._table.get(topic, self._others):
            yield from convert(name, message, times)

    def _body(self, _: str, state: PlantState, times: Times) -> Iterator[Sample]:
        """Yield the base's pose at every state, and the links' transforms less often."""
        position, quaternion = state.base_position, state.base_quaternion
        yield spatial.pose_in_frame(
            "/base/measured", times.stamp, spatial.WORLD_FRAME, position, quaternion
        )
        if not self._due(state.header.stamp):
            return
        first = self._last_transform is None
        self._last_transform = state.header.stamp
        frames = [Frame(BODY_FRAME, spatial.WORLD_FRAME, position, quaternion)]
        robot = self._robot
        if robot is not None:
            robot.place(state.joint_position, state.gripper_closure)
            frames += robot.frames()
            if first:
                yield spatial.robot_scene("/robot", times.stamp, robot.meshes())
            for side, site in HAND_FRAMES.items():
                yield spatial.pose_in_frame(
                    f"/hands/{side}/measured", times.stamp, BODY_FRAME, *robot.in_body(site)
                )
        yield spatial.frame_transforms("/tf", times.stamp, frames)

    def _event(self, name: str, message: Any, times: Times) -> Iterator[Sample]:
        text, warning = self._events.line(message)
        if text:
            yield spatial.log_line("/events", times.stamp, name, text, warning=warning)

    def _due(self, stamp: int) -> bool:
        last = self._last_transform
        # Robot time may start again, when the robot's side does.
        return last is None or not last <= stamp < last + TRANSFORM_PERIOD_NS


def _fields(name: str, message: Any, _: Times) -> Iterator[Sample]:
    yield protobuf_sample(f"/{name}", to_protobuf(message))


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


def _true_base(_: str, state: PlantState, times: Times) -> Iterator[Sample]:
    yield spatial.pose_in_frame(
        "/base/truth",
        times.stamp,
        spatial.WORLD_FRAME,
        state.base_position,
        state.base_quaternion,
    )


def _setpoints(_: str, setpoint: Setpoint, times: Times) -> Iterator[Sample]:
    for side in HAND_FRAMES:
        yield spatial.pose_in_frame(
            f"/hands/{side}/setpoint",
            times.stamp,
            BODY_FRAME,
            getattr(setpoint, f"{side}_hand_position_in_body"),
            getattr(setpoint, f"{side}_hand_quaternion_in_body"),
        )


def _image(name: str, frame: CameraFrame, times: Times) -> Iterator[Sample]:
    yield ros.compressed_image(f"/{name}", times.stamp, frame)


def _links(_: str, health: ServiceHealth, times: Times) -> Iterator[Sample]:
    for link in health.links:
        topic = f"/links/{health.service}/{link.topic}"
        yield protobuf_sample(topic, to_protobuf(link_plot(link)))


def _scene(_: str, scene: SceneState, times: Times) -> Iterator[Sample]:
    frames = [
        Frame(f"scene/{one.name}", spatial.WORLD_FRAME, one.position, one.quaternion)
        for one in (*scene.objects, *scene.marks)
    ]
    yield spatial.frame_transforms("/scene", times.stamp, frames)
