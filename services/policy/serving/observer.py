"""What a policy sees in one step: the same columns and the same pictures as in training."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.episodes.observation import observation
from common.episodes.oracle import oracle_numbers
from common.runtime.service import Inputs
from common.schemas import CameraFrame, ControllerState, PlantState
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    PLANT_STATE,
    PLANT_TRUTH,
    TASK_SCENE,
    WBC_STATE,
    Topic,
)
from services.policy.errors import ProcessorError
from services.policy.processor.actions import Command
from services.policy.processor.pictures import Picture, scale_picture
from services.policy.processor.processor import Processor

_EYES = {"left": CAMERA_LEFT, "right": CAMERA_RIGHT}
TOPICS: tuple[Topic[Any], ...] = (
    PLANT_STATE,
    WBC_STATE,
    CAMERA_LEFT,
    CAMERA_RIGHT,
    PLANT_TRUTH,
    TASK_SCENE,
)
"""All that a policy may observe."""


class Frame(NamedTuple):
    """One frame as the network takes it.

    Attributes:
        observation: (n,) float32.
        pictures: (cameras, height, width, 3) uint8.
    """

    observation: NDArray[np.float32]
    pictures: Picture


class UnseenError(ProcessorError):
    """There is no frame in this step; the message says why."""


class Observer:
    """Makes frames from a service's inputs.

    Attributes:
        topics: that it reads.
        picture_age: of the last pictures behind the robot's state [s]; -1: there are none.
    """

    def __init__(self, processor: Processor, stale_after: float) -> None:
        """Observe what ``processor`` wants; refuse pictures older than ``stale_after`` [s]."""
        self._processor = processor
        self._stale_after = stale_after
        self._eyes = tuple(_EYES[camera] for camera in processor.inputs.cameras)
        truth = (PLANT_TRUTH, TASK_SCENE) if processor.inputs.scene else ()
        wanted = {PLANT_STATE, WBC_STATE, *self._eyes, *truth}
        self.topics = tuple(topic for topic in TOPICS if topic in wanted)
        self.picture_age = -1.0
        self._stamp = -1
        width, height = processor.inputs.picture_size
        self._pictures: Picture = np.zeros((len(self._eyes), height, width, 3), dtype=np.uint8)

    def see(self, inputs: Inputs, previous: Command) -> Frame:
        """Return the frame of this step.

        Args:
            inputs: of the service.
            previous: the set-point of the step before.

        Raises:
            UnseenError: an input is missing, too old or damaged, or the robot has fallen.
            ProcessorError: pictures are smaller than the policy's.
            EpisodeError: the scene does not have what the policy was trained with.
        """
        state, controller = _fresh(inputs, PLANT_STATE), _fresh(inputs, WBC_STATE)
        if state.fallen:
            raise UnseenError("the robot has fallen")
        columns = self._columns(inputs, state, controller)
        self._look(inputs, state)
        return Frame(self._processor.frame(columns, previous), self._pictures)

    def _columns(
        self, inputs: Inputs, state: PlantState, controller: ControllerState
    ) -> dict[str, object]:
        columns = observation(state, controller)
        if names := self._processor.inputs.scene:
            truth, scene = _fresh(inputs, PLANT_TRUTH), _fresh(inputs, TASK_SCENE)
            columns["scene"] = oracle_numbers(names, truth, scene)
        return columns

    def _look(self, inputs: Inputs, state: PlantState) -> None:
        """Take the newest pictures of one moment."""
        if not self._eyes:
            return
        for eye in self._eyes:
            _fresh(inputs, eye)
        views: Any = (inputs.latest(self._eyes[0]),)
        if len(self._eyes) > 1:
            views = inputs.latest_pair(*self._eyes)
            if views is None:
                raise UnseenError("no two pictures of one moment")
        stamp = views[0].header.stamp
        self.picture_age = max(0.0, 1e-9 * (state.header.stamp - stamp))
        if self.picture_age > self._stale_after:
            raise UnseenError(f"the pictures are {self.picture_age:.1f} s behind the robot")
        if stamp != self._stamp:
            size = self._processor.inputs.picture_size
            self._pictures = np.stack([scale_picture(decoded(view), size) for view in views])
            self._stamp = stamp


def _fresh(inputs: Inputs, topic: Topic[Any]) -> Any:
    message = inputs.latest(topic)
    if message is None:
        raise UnseenError(f"no {topic.name} yet")
    if not inputs.fresh(topic):
        raise UnseenError(f"no {topic.name} for {inputs.age(topic):.1f} s")
    return message


def decoded(frame: CameraFrame) -> Picture:
    """Return the picture (height, width, 3) of a camera's message, RGB.

    Raises:
        UnseenError: it is damaged.
    """
    shape = (frame.height, frame.width, 3)
    data = np.frombuffer(frame.data, dtype=np.uint8)
    if frame.encoding == "jpeg":
        # A robot whose cameras send plain pixels needs no OpenCV.
        import cv2

        picture = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        data = np.zeros(0, np.uint8) if picture is None else np.asarray(picture)[:, :, ::-1]
    if data.size != frame.height * frame.width * 3:
        raise UnseenError(
            f"a picture of the {frame.eye} camera is damaged: expected {frame.encoding} of "
            f"{frame.width}x{frame.height}, got {len(frame.data)} bytes that are not"
        )
    return np.ascontiguousarray(data.reshape(shape))
