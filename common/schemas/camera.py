"""Camera images."""

from typing import Literal

from pydantic import Field

from common.schemas.base import Message


class CameraFrame(Message):
    """Image of one camera of the stereo pair, upright, row 0 on top.

    ``header.stamp`` is when the scene was captured.
    """

    eye: Literal["left", "right"]
    width: int = Field(ge=1, le=4096)
    height: int = Field(ge=1, le=4096)
    encoding: Literal["jpeg", "rgb8"]
    data: bytes = Field(description="JPEG file, or row-major 8-bit RGB")
