"""Encodes joints and images as ROS 2 messages (CDR)."""

from functools import cache

import cv2
import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from common.robot.joints import JOINT_NAMES
from common.schemas import CameraFrame
from services.logger.errors import ExportError
from services.logger.export.samples import Sample, SampleSchema

JOINT_STATE = "sensor_msgs/msg/JointState"
COMPRESSED_IMAGE = "sensor_msgs/msg/CompressedImage"
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


def camera_frame(eye: str) -> str:
    """Return the name of the frame of an eye's images."""
    return f"{eye}_camera"


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
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    time = _STORE.types["builtin_interfaces/msg/Time"](sec=seconds, nanosec=nanoseconds)
    return _STORE.types["std_msgs/msg/Header"](stamp=time, frame_id=frame_id)


def _cdr(message: object, kind: str) -> bytes:
    return bytes(_STORE.serialize_cdr(message, kind))


@cache
def _schema(kind: str) -> SampleSchema:
    text, _ = _STORE.generate_msgdef(kind, ros_version=2)
    return SampleSchema(kind, "ros2msg", "cdr", text.encode())
