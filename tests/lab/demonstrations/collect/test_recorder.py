"""A gait stands in the frame of its sample, whichever of both messages comes first."""

from collections.abc import Callable, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from common.schemas import ControllerState, Gait, GaitRequest, Header, PlantState, Setpoint
from common.topics import PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT, WBC_STATE
from lab.demonstrations.collect.recorder import EpisodeRecorder
from services.sim.config import SimConfig
from services.sim.physics.plant import Plant
from tests.common.transport.support import examples

MESSAGES = {type(message): message for message in examples()}
SAMPLES = (100, 150, 200)
"""Robot times of what the operator saw [ms]."""


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


def gaits(order: Callable[[list[Any]], Sequence[Any]]) -> list[int]:
    """Record three samples, the second with a gait; ``order`` arranges the messages of each."""
    stack = Stack()
    recorder = EpisodeRecorder(stack)  # type: ignore[arg-type]
    stack.send(PLANT_STATE, MESSAGES[PlantState])
    stack.send(WBC_STATE, MESSAGES[ControllerState])
    for sample in SAMPLES:
        header = Header(stamp=sample * 1_000_000)
        setpoint = MESSAGES[Setpoint].model_copy(update={"header": header})
        sent: list[Any] = [(TELEOP_SETPOINT, setpoint)]
        if sample == SAMPLES[1]:
            request = GaitRequest(header=header, request_id=1, gait=Gait.TURN_LEFT)
            sent.append((TELEOP_GAIT, request))
        for topic, message in order(sent):
            stack.send(topic, message)
    return [int(gait) for gait in np.array(recorder.rows.rows["action/locomotion"])]


@pytest.mark.parametrize("order", [list, lambda sent: sent[::-1]], ids=["after", "before"])
def test_the_order_of_both_messages_does_not_matter(
    order: Callable[[list[Any]], Sequence[Any]],
) -> None:
    assert gaits(order) == [0, int(Gait.TURN_LEFT), 0]
