"""Every message in the table as protobuf, field by field."""

from enum import IntEnum
from typing import Any

import numpy as np
import pytest
from pydantic import BaseModel

from common.schemas import ControllerState, ControlState, Gait, LinkHealth, Message, StageTime
from common.topics import ALL_TOPICS, Topic
from services.logger.errors import ExportError
from services.logger.export.fields import message_class, to_protobuf
from services.logger.export.links import link_plot
from tests.services.logger.export_support import health, plant


@pytest.mark.parametrize("topic", ALL_TOPICS, ids=lambda topic: topic.name)
def test_every_topic_has_a_counterpart_with_all_its_fields(topic: Topic[Any]) -> None:
    schema: type[Message] = topic.schema
    kind = message_class(schema)
    assert [field.name for field in kind.DESCRIPTOR.fields] == list(topic.schema.model_fields)
    assert kind.DESCRIPTOR.full_name == f"trill.{topic.schema.__name__}"


def test_numbers_arrays_enumerations_and_text() -> None:
    state = ControllerState(
        state=ControlState.LF_SWING,
        gait=Gait.TURN_LEFT,
        gait_progress=0.5,
        gaits_completed=3,
        dcm_error=0.002,
        com_in_world=np.array([0.1, 0.2, 0.7]),
        hand_position_error=np.array([0.01, 0.02]),
        hand_rotation_error=np.array([0.03, 0.04]),
        hand_weight=20.0,
        setpoint_fresh=True,
        solver="osqp",
        unsolved=1,
    )
    got = to_protobuf(state)
    kind = got.DESCRIPTOR.fields_by_name["state"].enum_type
    assert kind.values_by_number[got.state].name == "LF_SWING"
    assert got.DESCRIPTOR.fields_by_name["gait"].enum_type.full_name == (
        "trill.ControllerState.Gait.Value"
    )
    assert (got.gait, got.gaits_completed, got.solver) == (5, 3, "osqp")
    assert got.setpoint_fresh is True
    assert list(got.com_in_world) == [0.1, 0.2, 0.7]
    assert got.dcm_error == 0.002


def test_lists_of_models_and_a_random_63_bit_number() -> None:
    message = health("wbc")
    header = message.header.model_copy(update={"boot": 2**63 - 1, "source": "wbc"})
    got = to_protobuf(message.model_copy(update={"header": header}))
    assert got.header.boot == 2**63 - 1
    assert got.links[0].topic == "teleop/setpoint"
    assert [stage.stage for stage in got.links[0].stages] == ["wire", "injected"]
    assert got.links[0].stages[1].p99 == 0.19


def test_arrays_stay_in_order() -> None:
    got = to_protobuf(plant(3))
    assert list(got.base_quaternion) == plant(3).base_quaternion.tolist()
    assert list(got.joint_torque) == plant(3).joint_torque.tolist()


def test_a_type_without_counterpart_is_named() -> None:
    class Odd(BaseModel):
        what: dict[str, int] = {}

    with pytest.raises(ExportError, match=r"cannot export Odd\.what: expected a number.*dict"):
        message_class(Odd)


def test_an_enumeration_without_zero_is_refused() -> None:
    class Late(IntEnum):
        ONE = 1

    class Odd(BaseModel):
        what: Late = Late.ONE

    with pytest.raises(ExportError, match=r"Odd\.what.*Late has no member for 0"):
        message_class(Odd)


def test_every_stage_has_its_plot() -> None:
    stages = StageTime.model_fields["stage"].annotation.__args__  # type: ignore[union-attr]
    link = LinkHealth(
        topic="t",
        received=0,
        rate=0.0,
        age=0.0,
        gaps=0,
        refused=0,
        stages=[StageTime(stage=s, median=0.5, p99=0.75) for s in stages],
    )
    got = link_plot(link)
    for stage in stages:
        assert (getattr(got, f"{stage}_median"), getattr(got, f"{stage}_p99")) == (0.5, 0.75)
