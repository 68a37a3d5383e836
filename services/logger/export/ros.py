"""Encodes joints, images, poses, transforms and log lines as ROS 2 messages (CDR).

Quaternions are passed as (w, x, y, z) and written by field name; positions are in metres.
"""

from collections.abc import Iterable
from functools import cache
from math import tan

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from common.robot.joints import JOINT_NAMES
from common.schemas import CameraFrame
from services.logger.errors import ExportError
from services.logger.export.robot import Frame, Lens, camera_frame
from services.logger.export.samples import Sample, SampleSchema

JOINT_STATE = "sensor_msgs/msg/JointState"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
CAMERA_INFO = "sensor_msgs/msg/CameraInfo"
POSE_STAMPED = "geometry_msgs/msg/PoseStamped"
TRANSFORM_STAMPED = "geometry_msgs/msg/TransformStamped"
TF_MESSAGE = "tf2_msgs/msg/TFMessage"
LOG = "rcl_interfaces/msg/Log"
_INFO_LEVEL, _WARN_LEVEL = 20, 30
JPEG_QUALITY = 90
"""Quality of frames that were recorded as plain RGB."""

_STORE = get_typestore(Stores.ROS2_JAZZY)
_NAMES = list(JOINT_NAMES)

Array = NDArray[np.float64]


def joint_state(topic: str, stamp: int, position: Array, velocity: Array, effort: Array) -> Sample:
    """Encode the 27 joints with their names at the wall-clock time ``stamp`` [ns].

    ``position`` [rad], ``velocity`` [rad/s] and ``effort`` [N·m] have shape (27,).
    """
    message = _STORE.types[JOINT_STATE](
        header=_header(stamp, ""), name=_NAMES, position=position, velocity=velocity, effort=effort
    )
    return Sample(topic, _schema(JOINT_STATE), _cdr(message, JOINT_STATE))


def compressed_image(topic: str, stamp: int, frame: CameraFrame) -> Sample:
    """Encode a camera's frame: a JPEG as it is, plain RGB as JPEG.

    Raises:
        ExportError: the size of plain RGB does not match its data.
    """
    data = frame.data if frame.encoding == "jpeg" else _jpeg(frame)
    message = _STORE.types[COMPRESSED_IMAGE](
        header=_header(stamp, camera_frame(frame.eye)),
        format="jpeg",
        data=np.frombuffer(data, np.uint8),
    )
    return Sample(topic, _schema(COMPRESSED_IMAGE), _cdr(message, COMPRESSED_IMAGE))


def camera_info(topic: str, stamp: int, frame: CameraFrame, lens: Lens) -> Sample:
    """Encode the calibration of an ideal camera: square pixels, centred, without distortion."""
    focal = 0.5 * frame.height / tan(0.5 * lens.field_of_view)
    x, y = 0.5 * frame.width, 0.5 * frame.height
    region = _STORE.types["sensor_msgs/msg/RegionOfInterest"](
        x_offset=0, y_offset=0, height=0, width=0, do_rectify=False
    )
    shift = -focal * lens.baseline
    message = _STORE.types[CAMERA_INFO](
        header=_header(stamp, camera_frame(frame.eye)),
        height=frame.height,
        width=frame.width,
        distortion_model="plumb_bob",
        d=np.zeros(5),
        k=np.array([focal, 0, x, 0, focal, y, 0, 0, 1.0]),
        r=np.eye(3).ravel(),
        p=np.array([focal, 0, x, shift, 0, focal, y, 0, 0, 0, 1.0, 0]),
        binning_x=0,
        binning_y=0,
        roi=region,
    )
    return Sample(topic, _schema(CAMERA_INFO), _cdr(message, CAMERA_INFO))


def pose_in_frame(topic: str, stamp: int, frame: str, position: Array, quaternion: Array) -> Sample:
    """Encode a pose in ``frame``: ``position`` (3,) [m], ``quaternion`` (4,) w, x, y, z."""
    pose = _STORE.types["geometry_msgs/msg/Pose"](
        position=_vector("Point", position), orientation=_quaternion(quaternion)
    )
    message = _STORE.types[POSE_STAMPED](header=_header(stamp, frame), pose=pose)
    return Sample(topic, _schema(POSE_STAMPED), _cdr(message, POSE_STAMPED))


def frame_transforms(topic: str, stamp: int, frames: Iterable[Frame]) -> Sample:
    """Encode the pose of each frame in its parent."""
    transforms = [
        _STORE.types[TRANSFORM_STAMPED](
            header=_header(stamp, frame.parent),
            child_frame_id=frame.name,
            transform=_STORE.types["geometry_msgs/msg/Transform"](
                translation=_vector("Vector3", frame.position),
                rotation=_quaternion(frame.quaternion),
            ),
        )
        for frame in frames
    ]
    message = _STORE.types[TF_MESSAGE](transforms=transforms)
    return Sample(topic, _schema(TF_MESSAGE), _cdr(message, TF_MESSAGE))


def log_line(topic: str, stamp: int, name: str, text: str, *, warning: bool) -> Sample:
    """Encode an event as a line of text."""
    message = _STORE.types[LOG](
        stamp=_time(stamp),
        level=_WARN_LEVEL if warning else _INFO_LEVEL,
        name=name,
        msg=text,
        file="",
        function="",
        line=0,
    )
    return Sample(topic, _schema(LOG), _cdr(message, LOG))


def _jpeg(frame: CameraFrame) -> bytes:
    expected = frame.width * frame.height * 3
    if len(frame.data) != expected:
        raise ExportError(
            f"a {frame.width} x {frame.height} RGB frame of camera {frame.eye}: expected {expected}"
            f" bytes, got {len(frame.data)}"
        )
    rgb = np.frombuffer(frame.data, np.uint8).reshape(frame.height, frame.width, 3)
    quality = [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY]
    done, data = cv2.imencode(".jpg", cv2.cvtColor(rgb, cv2.COLOR_RGB2BGR), quality)
    if not done:
        raise ExportError(f"OpenCV could not encode a frame of camera {frame.eye} as JPEG")
    return bytes(data)


def _header(stamp: int, frame_id: str) -> object:
    return _STORE.types["std_msgs/msg/Header"](stamp=_time(stamp), frame_id=frame_id)


def _time(stamp: int) -> object:
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    return _STORE.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)


def _vector(kind: str, vector: Array) -> object:
    x, y, z = vector.tolist()
    return _STORE.types[f"geometry_msgs/msg/{kind}"](x=x, y=y, z=z)


def _quaternion(quaternion: Array) -> object:
    w, x, y, z = quaternion.tolist()
    return _STORE.types["geometry_msgs/msg/Quaternion"](x=x, y=y, z=z, w=w)


def _cdr(message: object, kind: str) -> bytes:
    return bytes(_STORE.serialize_cdr(message, kind))


@cache
def _schema(kind: str) -> SampleSchema:
    text, _ = _STORE.generate_msgdef(kind, ros_version=2)
    return SampleSchema(kind, "ros2msg", "cdr", text.encode())
