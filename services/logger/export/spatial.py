"""Encodes poses, transforms, shapes and log lines as foxglove protobuf messages.

Quaternions are passed as (w, x, y, z) and written by field name; positions are in metres.
"""

from collections.abc import Iterable, Sequence

import numpy as np
from foxglove_schemas_protobuf.FrameTransforms_pb2 import FrameTransforms
from foxglove_schemas_protobuf.Log_pb2 import Log
from foxglove_schemas_protobuf.PoseInFrame_pb2 import PoseInFrame
from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from numpy.typing import NDArray

from services.logger.export.meshes import LinkMesh
from services.logger.export.robot import Frame
from services.logger.export.samples import Sample, protobuf_sample

WORLD_FRAME = "world"

Array = NDArray[np.float64]


def pose_in_frame(topic: str, stamp: int, frame: str, position: Array, quaternion: Array) -> Sample:
    """Encode a pose in ``frame``: ``position`` (3,) [m], ``quaternion`` (4,) w, x, y, z."""
    message = PoseInFrame(frame_id=frame)
    message.timestamp.FromNanoseconds(stamp)
    _set_position(message.pose.position, position.tolist())
    _set_rotation(message.pose.orientation, quaternion.tolist())
    return protobuf_sample(topic, message)


def frame_transforms(topic: str, stamp: int, frames: Iterable[Frame]) -> Sample:
    """Encode the pose of each frame in its parent."""
    message = FrameTransforms()
    for frame in frames:
        transform = message.transforms.add(parent_frame_id=frame.parent, child_frame_id=frame.name)
        transform.timestamp.FromNanoseconds(stamp)
        _set_position(transform.translation, frame.position.tolist())
        _set_rotation(transform.rotation, frame.quaternion.tolist())
    return protobuf_sample(topic, message)


def robot_scene(topic: str, stamp: int, meshes: Sequence[LinkMesh]) -> Sample:
    """Encode the robot's shapes, each link's locked to its frame."""
    message = SceneUpdate()
    names = dict.fromkeys(mesh.link for mesh in meshes)
    links = {name: message.entities.add(frame_id=name, id=name) for name in names}
    for entity in links.values():
        entity.timestamp.FromNanoseconds(stamp)
        entity.frame_locked = True
    for mesh in meshes:
        shape = links[mesh.link].triangles.add()
        shape.pose.orientation.w = 1.0
        shape.color.r, shape.color.g, shape.color.b = mesh.colour
        shape.color.a = 1.0
        for x, y, z in mesh.vertices.tolist():
            shape.points.add(x=x, y=y, z=z)
        shape.indices.extend(mesh.triangles.ravel().tolist())
    return protobuf_sample(topic, message)


def log_line(topic: str, stamp: int, name: str, text: str, *, warning: bool) -> Sample:
    """Encode an event as a line of text."""
    level = Log.Level.WARNING if warning else Log.Level.INFO
    message = Log(level=level, message=text, name=name)
    message.timestamp.FromNanoseconds(stamp)
    return protobuf_sample(topic, message)


def _set_position(target: object, position: Sequence[float]) -> None:
    for name, value in zip("xyz", position, strict=True):
        setattr(target, name, value)


def _set_rotation(target: object, quaternion: Sequence[float]) -> None:
    for name, value in zip("wxyz", quaternion, strict=True):
        setattr(target, name, value)
