"""Poses, transforms, shapes and log lines as foxglove protobuf messages.

Quaternions come in as (w, x, y, z) and leave by field name; positions are in metres.
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
    """A pose (``position`` (3,) [m], ``quaternion`` (4,) w, x, y, z) expressed in ``frame``."""
    message = PoseInFrame(frame_id=frame)
    message.timestamp.FromNanoseconds(stamp)
    _place(message.pose.position, position.tolist())
    _turn(message.pose.orientation, quaternion.tolist())
    return protobuf_sample(topic, message)


def frame_transforms(topic: str, stamp: int, frames: Iterable[Frame]) -> Sample:
    """Where each frame is in its parent."""
    message = FrameTransforms()
    for frame in frames:
        transform = message.transforms.add(parent_frame_id=frame.parent, child_frame_id=frame.name)
        transform.timestamp.FromNanoseconds(stamp)
        _place(transform.translation, frame.position.tolist())
        _turn(transform.rotation, frame.quaternion.tolist())
    return protobuf_sample(topic, message)


def robot_scene(topic: str, stamp: int, meshes: Sequence[LinkMesh]) -> Sample:
    """The robot's looks, each link's locked to its frame, for ever."""
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
    """Something that happened, in words."""
    level = Log.Level.WARNING if warning else Log.Level.INFO
    message = Log(level=level, message=text, name=name)
    message.timestamp.FromNanoseconds(stamp)
    return protobuf_sample(topic, message)


def _place(target: object, position: Sequence[float]) -> None:
    for name, value in zip("xyz", position, strict=True):
        setattr(target, name, value)


def _turn(target: object, quaternion: Sequence[float]) -> None:
    for name, value in zip("wxyz", quaternion, strict=True):
        setattr(target, name, value)
