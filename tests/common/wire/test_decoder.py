"""A decoder that remembers earlier messages agrees with one that remembers nothing."""

import random
from typing import Any

import numpy as np
import pytest

from common.errors import SchemaError
from common.schemas import (
    ControllerState,
    Header,
    JointCommand,
    Message,
    PlantAction,
    PlantRequest,
    PlantState,
)
from common.wire import decoder as module
from common.wire.codec import decode, encode, schema_tag
from common.wire.decoder import Decoder
from common.wire.template import template_of
from tests.common.transport.support import examples, plant_state

pytestmark = pytest.mark.usefixtures("compiled_or_not")
HEADER = Header(
    seq=1000, stamp=10**12, captured=2**40, sent=2**41, encode=30_000, boot=2**62, source="sim"
)
EXAMPLES = {type(message): message for message in examples()}


def later(**changes: int) -> Header:
    update = {"seq": 1001, "stamp": 10**12 + 5, "sent": 2**41 + 9} | changes
    return HEADER.model_copy(update=update)


def primed(message: Message) -> Decoder[Any]:
    """Return a decoder that has seen the message."""
    decoder = Decoder(type(message))
    decoder.decode(encode(message, HEADER))
    return decoder


def outcome(function: Any, payload: bytes, schema: type[Message]) -> object:
    """Return what becomes of a payload: the message's bytes and types, or the refusal."""
    try:
        message = function(payload)
    except SchemaError as error:
        return str(error)
    types = [(name, type(value)) for name, value in message.__dict__.items()]
    assert isinstance(message, schema)
    return encode(message, message.header), types, message.model_fields_set


@pytest.fixture
def only_templates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Make what is not read by a template fail."""

    def refuse(*_arguments: object) -> None:
        raise AssertionError("not read by a template")

    monkeypatch.setattr(module, "decode", refuse)


@pytest.mark.parametrize("schema", [PlantState, JointCommand])
def test_like_messages_are_read_by_a_template(
    schema: type[Message], request: pytest.FixtureRequest
) -> None:
    decoder = primed(EXAMPLES[schema])
    other = EXAMPLES[schema].model_copy(update={"gripper_closure": np.array([0.125, 1e300])})
    payload = encode(other, later())
    plain = decode(payload, schema)
    request.getfixturevalue("only_templates")
    message = decoder.decode(payload)
    assert list(message.__dict__) == list(plain.__dict__)
    assert message.header == later()
    assert encode(message, message.header) == payload
    assert not message.gripper_closure.flags.writeable
    assert message.gripper_closure.tolist() == [0.125, 1e300]


def test_the_injected_delay_is_noted(request: pytest.FixtureRequest) -> None:
    decoder = Decoder(PlantState)
    assert decoder.decode(encode(plant_state(), HEADER), None, 9).header.injected == 9
    request.getfixturevalue("only_templates")
    payload = encode(plant_state(), later())
    assert decoder.decode(payload, None, 7).header.injected == 7
    assert decoder.decode(payload).header.injected == 0


@pytest.mark.parametrize("message", EXAMPLES.values(), ids=lambda message: type(message).__name__)
def test_damaged_messages_fare_the_same(message: Message) -> None:
    schema, decoder, rng = type(message), primed(message), random.Random(0)
    for number in range(150):
        payload = bytearray(encode(message, later(seq=1001 + number)))
        for _ in range(rng.randint(0, 2)):
            payload[rng.randrange(len(payload))] = rng.choice((0, 0x7F, 0xFF, rng.randrange(256)))
        decoder.decode(encode(message, HEADER))
        damaged = bytes(payload)
        got = outcome(decoder.decode, damaged, schema)
        assert got == outcome(lambda data, s=schema: decode(data, s), damaged, schema)


@pytest.mark.parametrize("wrong", [np.nan, np.inf, -np.inf])
def test_numbers_that_are_not_finite_are_refused(wrong: float) -> None:
    values = np.linspace(-1.0, 1.0, 27)
    values[5] = wrong
    bad = plant_state().model_copy(update={"joint_velocity": values})
    with pytest.raises(SchemaError, match="PlantState: joint_velocity: expected finite numbers"):
        primed(plant_state()).decode(encode(bad, later()))


def test_wrong_quaternions_and_counts_are_refused() -> None:
    decoder = primed(plant_state())
    bad = plant_state().model_copy(update={"base_quaternion": np.array([1.0, 0.1, 0.0, 0.0])})
    with pytest.raises(SchemaError, match="base_quaternion: expected a unit quaternion"):
        decoder.decode(encode(bad, later()))
    with pytest.raises(SchemaError, match=r"header\.boot: Input should be less than 92233720"):
        decoder.decode(encode(plant_state(), later(boot=2**63)))


def test_numbers_outside_arrays_are_read_and_validated(request: pytest.FixtureRequest) -> None:
    state = EXAMPLES[ControllerState]
    decoder = primed(state)
    wrong = state.model_copy(update={"gait_progress": 1.5})
    with pytest.raises(SchemaError, match="gait_progress: Input should be less than or equal to 1"):
        decoder.decode(encode(wrong, later()))
    request.getfixturevalue("only_templates")
    other = state.model_copy(update={"gait_progress": 0.75, "dcm_error": 1e-9})
    message = decoder.decode(encode(other, later()))
    assert (message.gait_progress, message.dcm_error) == (0.75, 1e-9)
    assert encode(message, later()) == encode(other, later())


def test_another_schema_is_refused_though_its_bytes_would_do() -> None:
    decoder, payload = primed(plant_state()), encode(plant_state(), later())
    assert decoder.decode(payload, schema_tag(PlantState)).header.seq == 1001
    with pytest.raises(SchemaError, match="trill/PlantState/2"):
        decoder.decode(payload, "trill/PlantState/2;0123456789ab")


def test_a_validator_of_the_schema_is_asked_each_time() -> None:
    push = PlantRequest(action=PlantAction.PUSH, force=np.array([9.0, 0.0, 0.0]))
    decoder = primed(push)
    too_hard = push.model_copy(update={"force": np.array([9000.0, 0.0, 0.0])})
    with pytest.raises(SchemaError, match="at most 2000 N"):
        decoder.decode(encode(too_hard, later()))


def test_messages_that_always_differ_are_not_remembered_each_time(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    made: list[int] = []

    def counted(payload: bytes, message: Message, *others: Any) -> Any:
        made.append(message.header.seq)
        return template_of(payload, message, *others)

    monkeypatch.setattr(module, "template_of", counted)
    decoder = Decoder(ControllerState)
    for number in range(500):
        message = EXAMPLES[ControllerState].model_copy(update={"obstacle": f"{number:04}"})
        payload = encode(message, later(seq=1000 + number))
        assert decoder.decode(payload).obstacle == f"{number:04}"
    assert made[:4] == [1000, 1001, 1002, 1003]
    assert len(made) == 5
    assert len(set(made)) == 5


def test_counts_outside_the_header_are_read_and_validated(
    request: pytest.FixtureRequest,
) -> None:
    state = EXAMPLES[ControllerState].model_copy(update={"setpoint_stamp": 2**40})
    decoder = primed(state)
    decoder.decode(encode(state.model_copy(update={"setpoint_stamp": 2**41}), later()))
    wrong = state.model_copy(update={"setpoint_stamp": 2**63})
    with pytest.raises(SchemaError, match="setpoint_stamp: Input should be less than"):
        decoder.decode(encode(wrong, later()))
    request.getfixturevalue("only_templates")
    other = state.model_copy(update={"setpoint_stamp": 2**62 + 1})
    message = decoder.decode(encode(other, later()))
    assert message.setpoint_stamp == 2**62 + 1
    assert encode(message, later()) == encode(other, later())
