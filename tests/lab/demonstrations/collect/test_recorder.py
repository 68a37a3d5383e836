"""A gait stands in the frame of its sample, whenever it comes; a frame needs a picture."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any, TypeVar

import numpy as np
import pytest

from common.schemas import (
    CameraFrame,
    ControllerState,
    Gait,
    GaitRequest,
    Header,
    Message,
    PlantState,
    Setpoint,
)
from common.topics import PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT, WBC_STATE
from lab.demonstrations.collect.pictures import PictureInput
from lab.demonstrations.collect.recorder import EpisodeRecorder
from services.sim.config import SimConfig
from services.sim.physics.plant import Plant
from tests.common.transport.support import examples

MESSAGES = {type(message): message for message in examples()}
SAMPLES = (100, 150, 200)
"""Times at which the operator sampled its device [ms]."""
M = TypeVar("M", bound=Message)
Sent = list[tuple[Any, Any]]


class Stack:
    """Hands messages to the recorder, with a plant that stands still."""

    def __init__(self) -> None:
        self.plant = SimpleNamespace(plant=Plant(SimConfig(task="door/unlock")))
        self.runner = self
        self._hear: dict[str, Callable[[Any], None]] = {}
        self._newest: dict[str, Any] = {}

    def on_message(self, topic: Any, hear: Callable[[Any], None]) -> None:
        self._hear[topic.name] = hear

    def newest(self, topic: Any) -> Callable[[], Any]:
        return lambda: self._newest.get(topic.name)

    def send(self, topic: Any, message: Any) -> None:
        self._newest[topic.name] = message
        if hear := self._hear.get(topic.name):
            hear(message)


def made(kind: type[M], **changes: object) -> M:
    """A message like the example of its kind, with changes."""
    example = MESSAGES[kind]
    assert isinstance(example, kind)
    return example.model_copy(update=changes)


def picture(number: int) -> CameraFrame:
    """A picture that stands for the moment of this number."""
    return made(CameraFrame, data=str(number).encode())


def recorded() -> tuple[Stack, EpisodeRecorder, PictureInput]:
    """A recorder that has heard from robot and controller, without a picture yet."""
    stack, pictures = Stack(), PictureInput()
    recorder = EpisodeRecorder(stack, pictures)  # type: ignore[arg-type]
    stack.send(PLANT_STATE, MESSAGES[PlantState])
    stack.send(WBC_STATE, MESSAGES[ControllerState])
    return stack, recorder, pictures


def header(sampled: int, seen: int) -> Header:
    """Of a message of the sample at a time, when the newest thing seen was of another [ms]."""
    return Header(stamp=seen * 1_000_000, captured=sampled * 1_000_000)


def setpoint(sampled: int, seen: int) -> tuple[Any, Setpoint]:
    return TELEOP_SETPOINT, made(Setpoint, header=header(sampled, seen))


def turn(sampled: int, seen: int) -> tuple[Any, GaitRequest]:
    request = GaitRequest(header=header(sampled, seen), request_id=1, gait=Gait.TURN_LEFT)
    return TELEOP_GAIT, request


def gaits(messages: Sent) -> list[int]:
    """Record messages in this order and return the gait of each frame."""
    stack, recorder, pictures = recorded()
    pictures.newest = picture(0)
    for topic, message in messages:
        stack.send(topic, message)
    return [int(gait) for gait in np.array(recorder.rows.rows["action/locomotion"])]


@pytest.mark.parametrize("place", range(len(SAMPLES) + 1))
def test_a_gait_belongs_to_its_sample_wherever_it_comes_in_the_order(place: int) -> None:
    """Among three samples it is the second's: before, after, and later than the third."""
    messages: Sent = [setpoint(sample, sample) for sample in SAMPLES]
    messages.insert(place, turn(SAMPLES[1], SAMPLES[1]))
    assert gaits(messages) == [0, int(Gait.TURN_LEFT), 0]


@pytest.mark.parametrize("order", [list, lambda sent: sent[::-1]], ids=["after", "before"])
def test_while_nothing_new_is_seen_the_samples_stay_apart(
    order: Callable[[Sent], Sequence[Any]],
) -> None:
    messages: Sent = [setpoint(SAMPLES[0], 70)]
    messages += order([setpoint(SAMPLES[1], 70), turn(SAMPLES[1], 70)])
    messages += [setpoint(SAMPLES[2], 70)]
    assert gaits(messages) == [0, int(Gait.TURN_LEFT), 0]


def test_a_gait_without_its_set_point_is_in_no_other_frame() -> None:
    messages: Sent = [setpoint(SAMPLES[0], SAMPLES[0]), turn(SAMPLES[1], SAMPLES[1])]
    assert gaits([*messages, setpoint(SAMPLES[2], SAMPLES[2])]) == [0, 0]


def test_frames_begin_with_the_first_picture_and_say_which_they_show() -> None:
    stack, recorder, pictures = recorded()
    stack.send(*setpoint(SAMPLES[0], SAMPLES[0]))
    assert not len(recorder.rows)
    for number, sample in ((0, SAMPLES[1]), (0, SAMPLES[2]), (1, 250)):
        pictures.newest = picture(number)
        stack.send(*setpoint(sample, sample))
    assert recorder.moments == [0, 0, 1]
    assert recorder.rows.rows["time/seen_ns"] == [150_000_000, 200_000_000, 250_000_000]
