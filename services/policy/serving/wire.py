"""What a robot and an inference server say to each other, as bytes.

Shapes are those of the checkpoint that both have, so that a message cannot lie about them; its
SHA-256 travels along. Nothing is unpickled.
"""

import math
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from common.errors import SchemaError
from common.schemas import Header, Message
from common.schemas.base import Count
from common.wire.codec import decode, encode, schema_tag
from services.policy.checkpoint.manifest import Description
from services.policy.processor.processor import Decision
from services.policy.processor.targets import GAITS
from services.policy.serving.engine import Answer, Request

MAX_FRAMES = 128
"""Longest sequence of a request."""
_M = TypeVar("_M", bound=Message)
_Number = TypeVar("_Number", np.float32, np.uint8)


class InferenceRequest(Message):
    """Frames of which a decision is wanted; see :class:`services.policy.serving.engine.Request`."""

    checkpoint: str = Field(max_length=64, description="SHA-256 of its manifest")
    step: Count
    frames: int = Field(ge=1, le=MAX_FRAMES, description="how many, oldest first")
    observations: bytes = Field(description="float32 [frames, numbers]")
    pictures: bytes = Field(description="8-bit RGB [frames, cameras, height, width, 3]")
    memory: bytes = Field(description="float32, recurrent state before the first frame")


class InferenceAnswer(Message):
    """Decision of a request's last frame; see :class:`services.policy.serving.engine.Answer`."""

    checkpoint: str = Field(max_length=64, description="SHA-256 of its manifest")
    step: Count = Field(description="of the request")
    hands: bytes = Field(description="float32 [steps, numbers]")
    grasp: bytes = Field(description="float32 [steps, 2]")
    gait: bytes = Field(description="float32 [7]")
    memory: bytes = Field(description="float32, recurrent state after the last frame")
    seconds: float = Field(ge=0.0, description="time that the inference took [s]")


class WireFormat:
    """Encodes and decodes the requests and answers of one checkpoint."""

    def __init__(self, description: Description) -> None:
        self.checkpoint = description.digest
        interface = description.manifest.interface
        width, height = interface.picture_size
        self._width = sum(count for _, count in interface.observation)
        self._picture = (len(interface.cameras), height, width, 3)
        self._memory = interface.memory
        self._hands = interface.hands

    def pack_request(self, request: Request) -> bytes:
        """Return a request as bytes."""
        return _packed(
            InferenceRequest(
                checkpoint=self.checkpoint,
                step=request.step,
                frames=len(request.observations),
                observations=request.observations.astype("<f4").tobytes(),
                pictures=request.pictures.tobytes(),
                memory=request.memory.astype("<f4").tobytes(),
            )
        )

    def unpack_request(self, payload: bytes, tag: str) -> Request:
        """Return a request.

        Raises:
            SchemaError: it is none, of another version, or of another checkpoint.
        """
        said = self._checked(payload, InferenceRequest, tag)
        frames = said.frames
        pixels = _array("pictures", said.pictures, np.uint8, (frames, *self._picture))
        return Request(
            said.step,
            _floats("observations", said.observations, (frames, self._width)),
            pixels,
            _floats("memory", said.memory, self._memory),
        )

    def pack_answer(self, answer: Answer) -> bytes:
        """Return an answer as bytes."""
        hands, grasp, gait = (part.astype("<f4").tobytes() for part in answer.decision)
        return _packed(
            InferenceAnswer(
                checkpoint=self.checkpoint,
                step=answer.step,
                hands=hands,
                grasp=grasp,
                gait=gait,
                memory=answer.memory.astype("<f4").tobytes(),
                seconds=answer.seconds,
            )
        )

    def unpack_answer(self, payload: bytes, tag: str) -> Answer:
        """Return an answer.

        Raises:
            SchemaError: it is none, of another version, or of another checkpoint.
        """
        said = self._checked(payload, InferenceAnswer, tag)
        steps = self._hands[0]
        decision = Decision(
            _floats("hands", said.hands, self._hands),
            _floats("grasp", said.grasp, (steps, 2)),
            _floats("gait", said.gait, (GAITS,)),
        )
        memory = _floats("memory", said.memory, self._memory)
        return Answer(said.step, decision, memory, said.seconds)

    def _checked(self, payload: bytes, schema: type[_M], tag: str) -> _M:
        said = decode(payload, schema, tag)
        checkpoint: str = vars(said)["checkpoint"]
        if checkpoint != self.checkpoint:
            raise SchemaError(
                f"expected the checkpoint {self.checkpoint[:12]}…, got {checkpoint[:12]}…; start "
                "robot and inference server with copies of one checkpoint"
            )
        return said


REQUEST_TAG, ANSWER_TAG = schema_tag(InferenceRequest), schema_tag(InferenceAnswer)
"""Names of the schemas in the transport's encoding."""


def _packed(message: Message) -> bytes:
    return encode(message, Header())


def _floats(name: str, content: bytes, shape: tuple[int, ...]) -> NDArray[np.float32]:
    array = _array(name, content, np.float32, shape)
    if not np.isfinite(array).all():
        raise SchemaError(f"expected finite numbers in {name}, got NaN or infinity")
    return array


def _array(
    name: str, content: bytes, kind: type[_Number], shape: tuple[int, ...]
) -> NDArray[_Number]:
    expected = math.prod(shape) * np.dtype(kind).itemsize
    if len(content) != expected:
        raise SchemaError(f"expected {expected} bytes of {name} {list(shape)}, got {len(content)}")
    # A copy, because torch warns of arrays that it may not write.
    return np.frombuffer(content, dtype=kind).reshape(shape).copy()
