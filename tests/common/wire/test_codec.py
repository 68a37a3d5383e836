"""Messages survive the wire exactly, and nothing else gets through."""

from collections.abc import Callable
from typing import Any

import msgpack
import numpy as np
import pytest
from pydantic import ValidationError, field_validator, model_validator

from common.errors import SchemaError
from common.schemas import (
    Estop,
    Gait,
    GaitRequest,
    GuardMode,
    Header,
    Message,
    PlantState,
    PlantStatus,
    ServiceHealth,
)
from common.topics import ALL_TOPICS
from common.wire.codec import MAX_PAYLOAD, decode, encode, schema_hash, schema_tag
from tests.common.transport.support import HEADER, JOINTS, examples, health, plant_state

pytestmark = pytest.mark.usefixtures("compiled_or_not")


class Values(Message):
    """Every kind of plain value."""

    number: int = 0
    text: str = ""
    real: float = 0.0
    flag: bool = False
    nothing: None = None
    mode: GuardMode = GuardMode.HOLD


@pytest.mark.parametrize(
    "values",
    [
        *(
            {"number": s * (2**k + d)}
            for k in (5, 7, 8, 15, 16, 31, 32, 63)
            for s in (1, -1)
            for d in (-1, 0)
        ),
        {"number": 2**64 - 1},
        *({"text": "é" * size} for size in (15, 16, 127, 128, 32_767, 32_768)),
        {"real": -0.0, "flag": True},
        {"real": 1e-308, "flag": True},
    ],
)
def test_plain_values_are_packed_as_msgpack_does(values: dict[str, Any]) -> None:
    message = Values.model_construct(**values)
    fields = message.__dict__ | {"header": HEADER.__dict__}
    assert encode(message, HEADER) == msgpack.packb(fields)


@pytest.mark.parametrize(
    "values", [{"number": 2**64}, {"number": -(2**63) - 1}, {"text": "\ud800"}]
)
def test_what_does_not_fit_the_wire_is_refused(values: dict[str, Any]) -> None:
    with pytest.raises(SchemaError, match=r"Values does not fit the wire: .*; expected 64-bit"):
        encode(Values.model_construct(**values), HEADER)


def test_an_array_that_is_not_contiguous_is_packed_by_value() -> None:
    state = plant_state()
    wide = np.repeat(state.joint_position, 2).reshape(-1, 2)
    strided = state.model_copy(update={"joint_position": wide[:, 0]})
    assert encode(strided, HEADER) == encode(state, HEADER)


def test_examples_cover_every_schema_on_the_bus() -> None:
    assert {type(message) for message in examples()} == {topic.schema for topic in ALL_TOPICS}


@pytest.mark.parametrize("message", examples(), ids=lambda message: type(message).__name__)
def test_round_trip_is_exact(message: Message) -> None:
    back = decode(encode(message, HEADER), type(message), schema_tag(type(message)))
    assert type(back) is type(message)
    assert back.header == HEADER
    for name in type(message).model_fields:
        if name == "header":
            continue
        sent, got = getattr(message, name), getattr(back, name)
        if isinstance(sent, np.ndarray):
            assert got.dtype == np.float64
            assert got.shape == sent.shape
            assert got.tobytes() == sent.tobytes()
            assert not got.flags.writeable
        else:
            # Dumped: parts of a message may hold arrays, which have no plain equality.
            assert back.model_dump(include={name}) == message.model_dump(include={name})
            assert type(got) is type(sent)


def test_the_message_itself_keeps_its_header() -> None:
    message = plant_state(seq=3)
    encode(message, HEADER)
    assert message.header.seq == 3


def test_decoded_message_behaves_like_one_built_by_hand() -> None:
    message = Estop(reason="x", header=HEADER)
    back = decode(encode(message, HEADER), Estop)
    assert back == message
    assert back.model_fields_set == {"header", "reason", "pressed"}
    with pytest.raises(ValueError, match="frozen"):
        back.reason = "y"


def test_arrays_are_little_endian_bytes_under_their_names() -> None:
    fields = msgpack.unpackb(encode(plant_state(), HEADER))
    assert fields["joint_position"] == JOINTS.astype("<f8").tobytes()
    assert list(fields) == list(PlantState.model_fields)
    assert fields["header"]["seq"] == 7


def test_injected_delay_is_noted_in_the_header() -> None:
    back = decode(encode(plant_state(), HEADER), PlantState, injected_ns=250)
    assert back.header == HEADER.model_copy(update={"injected": 250})


def altered(message: Message, change: Callable[[dict[str, Any]], None]) -> bytes:
    fields = msgpack.unpackb(encode(message, HEADER))
    change(fields)
    return bytes(msgpack.packb(fields))


def put(name: str, value: object) -> Callable[[dict[str, Any]], None]:
    return lambda fields: fields.__setitem__(name, value)


NAN = np.full(27, np.nan).tobytes()
ONE_INF = np.r_[np.zeros(26), np.inf].tobytes()
LARGE = np.full(27, 1.7e308).tobytes()


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (put("joint_position", NAN), "joint_position: expected finite"),
        (put("joint_torque", ONE_INF), "joint_torque: expected finite"),
        (
            put("joint_position", b"\0" * 208),
            r"joint_position.*216 bytes \(float64\[27\]\), got 208",
        ),
        (put("joint_position", [0.0] * 27), "joint_position.*got list"),
        (put("joint_position", 5), "joint_position.*got int"),
        (put("joint_position", "x" * 216), "joint_position.*got str"),
        (put("base_quaternion", np.array([1.0, 0.1, 0, 0]).tobytes()), "unit quaternion.*1.00499"),
        (put("base_quaternion", np.zeros(4).tobytes()), "unit quaternion.*norm 0"),
        (put("extra", 1), "unknown field 'extra'"),
        (lambda fields: fields.pop("base_position"), "missing field 'base_position'"),
        (lambda fields: fields.pop("reset_count"), "missing field 'reset_count'"),
        (put("reset_count", -1), "reset_count"),
        (put("reset_count", 1.5), "reset_count"),
        (put("header", 3), "header"),
        (put("header", {"seq": "many"}), "header.seq"),
    ],
)
def test_wrong_states_are_refused_naming_the_field(
    change: Callable[[dict[str, Any]], None], text: str
) -> None:
    with pytest.raises(SchemaError, match=text):
        decode(altered(plant_state(), change), PlantState, injected_ns=1)


def test_values_whose_sum_overflows_are_still_finite() -> None:
    back = decode(altered(plant_state(), put("joint_torque", LARGE)), PlantState)
    assert back.joint_torque[26] == 1.7e308


@pytest.mark.parametrize(
    ("change", "text"),
    [
        (put("guard", 7), "guard"),
        (put("real_time_factor", float("nan")), "real_time_factor"),
        (put("real_time_factor", float("inf")), "real_time_factor"),
        (put("saturated_fraction", 1.1), "saturated_fraction"),
    ],
)
def test_wrong_scalars_are_refused(change: Callable[[dict[str, Any]], None], text: str) -> None:
    status = next(message for message in examples() if isinstance(message, PlantStatus))
    with pytest.raises(SchemaError, match=text):
        decode(altered(status, change), PlantStatus)


def test_enumerations_travel_as_numbers() -> None:
    status = next(message for message in examples() if isinstance(message, PlantStatus))
    payload = encode(status, HEADER)
    assert msgpack.unpackb(payload)["guard"] == 2
    assert decode(payload, PlantStatus).guard is GuardMode.HOLD


def test_nested_links_are_checked() -> None:
    def spoil(fields: dict[str, Any]) -> None:
        fields["links"][1]["gaps"] = -1

    with pytest.raises(SchemaError, match=r"links\.1\.gaps"):
        decode(altered(health(), spoil), ServiceHealth)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"\x93\x01\x02\x03",
        b"\x05",
        b"\x81" * 5000,
        b"\x91" * 5000,
        b"\xdd\xff\xff\xff\xff",
        b"\xdf\xff\xff\xff\xff",
        b"\xc6\xff\xff\xff\xff",
        b"\xdc\x04\x00" * 2000,
        b"\x81\xa1\xff\x00",
        b"\x81\x91\x01\x00",
        b"\x81\x80\x00",
        b"\xc7\x0c\xff" + b"\xff" * 12,
        b"\xd6\xff\x00\x00\x00\x00",
    ],
)
def test_malformed_msgpack_is_refused(payload: bytes) -> None:
    for topic in ALL_TOPICS:
        with pytest.raises(SchemaError, match=r"msgpack|field"):
            decode(payload, topic.schema)


def test_announced_sizes_are_refused_before_memory_is_taken() -> None:
    # 500 lists of 100 000 entries, one inside the other: 400 MB from half a kilobyte of headers.
    bomb = b"\xdd\x00\x01\x86\xa0" * 500 + bytes(100_000)
    with pytest.raises(SchemaError, match="exceeds max_array_len"):
        decode(bomb, PlantState)
    with pytest.raises(SchemaError, match="exceeds max_map_len"):
        decode(b"\xdf\x00\x01\x86\xa0" + bytes(200_000), PlantState)


def test_truncated_or_extended_payload_is_refused() -> None:
    payload = encode(plant_state(), HEADER)
    for length in range(0, len(payload), 7):
        with pytest.raises(SchemaError, match="not one msgpack map"):
            decode(payload[:length], PlantState)
    with pytest.raises(SchemaError, match="extra data"):
        decode(payload + b"\0", PlantState)


def test_oversized_payload_is_refused_unread() -> None:
    with pytest.raises(SchemaError, match="at most"):
        decode(bytes(MAX_PAYLOAD + 1), PlantState)


def test_error_texts_stay_short() -> None:
    payload = msgpack.packb({f"field number {i}" * 30: i for i in range(100)})
    with pytest.raises(SchemaError) as caught:
        decode(payload, PlantState, "tag" * 500)
    assert len(str(caught.value)) <= 400


def test_tag_of_another_schema_is_refused_naming_both_and_the_fields() -> None:
    with pytest.raises(SchemaError) as caught:
        decode(encode(health(), HEADER), GaitRequest, schema_tag(ServiceHealth))
    text = str(caught.value)
    assert f"trill/ServiceHealth/1;{schema_hash(ServiceHealth)}" in text
    assert f"trill/GaitRequest/1;{schema_hash(GaitRequest)}" in text
    assert "missing field 'gait'" in text
    assert "unknown field 'cpu'" in text


def test_tag_differs_where_no_field_does() -> None:
    tag = schema_tag(PlantState).replace(schema_hash(PlantState), "0" * 12)
    with pytest.raises(SchemaError, match=r"names and sizes agree.*same version"):
        decode(encode(plant_state(), HEADER), PlantState, tag)
    with pytest.raises(SchemaError, match="received no schema"):
        decode(encode(plant_state(), HEADER), PlantState, "")


def test_what_does_not_fit_the_wire_is_refused_on_encoding() -> None:
    with pytest.raises(SchemaError, match="GaitRequest does not fit"):
        encode(GaitRequest(request_id=2**70, gait=Gait.NONE), HEADER)


def test_validators_of_one_field_are_run() -> None:
    class Even(Message):
        value: int

        @field_validator("value")
        @classmethod
        def _even(cls, value: int) -> int:
            if value % 2:
                raise ValueError("the value is odd")
            return value

    assert decode(encode(Even(value=2), Header()), Even).value == 2
    with pytest.raises(SchemaError, match="odd"):
        decode(altered(Even(value=2), put("value", 3)), Even)


def test_a_decoded_message_is_one_as_any_other() -> None:
    message = plant_state()
    back = decode(encode(message, HEADER), PlantState)
    assert back.model_fields_set == set(PlantState.model_fields)
    changed = back.model_copy(update={"reset_count": 9})
    assert (changed.reset_count, back.reset_count) == (9, 2)
    with pytest.raises(ValidationError, match="frozen"):
        back.reset_count = 3
    again = PlantState.model_validate(back.model_dump())
    assert again.joint_position.tolist() == message.joint_position.tolist()


def test_validators_on_a_whole_message_are_run() -> None:
    class Range(Message):
        low: int
        high: int

        @model_validator(mode="after")
        def _ordered(self) -> "Range":
            if self.low > self.high:
                raise ValueError("low is above high")
            return self

    assert decode(encode(Range(low=1, high=2), Header()), Range).high == 2
    with pytest.raises(SchemaError, match="low is above high"):
        decode(altered(Range(low=1, high=2), put("low", 3)), Range)
