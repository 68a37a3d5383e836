"""Whatever the bytes are, decoding either yields a valid message or raises SchemaError."""

from typing import Any

import msgpack
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from common.errors import SchemaError
from common.schemas import Message
from common.topics import ALL_TOPICS
from common.wire.codec import decode, encode
from tests.common.transport.support import HEADER, examples

SCHEMAS = sorted({topic.schema for topic in ALL_TOPICS}, key=lambda schema: schema.__name__)
EXAMPLES = {type(message): message for message in examples()}

many = settings(
    max_examples=60,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.too_slow],
)

leaves = st.one_of(
    st.none(),
    st.booleans(),
    st.integers(-(2**63), 2**64 - 1),
    st.floats(),
    st.text(max_size=20),
    st.binary(max_size=40),
    st.just(np.full(27, np.nan).tobytes()),
    st.just(np.zeros(27).tobytes()),
    st.just(np.zeros(4).tobytes()),
)
values = st.recursive(
    leaves,
    lambda inner: st.one_of(
        st.lists(inner, max_size=4), st.dictionaries(st.text(max_size=8), inner, max_size=4)
    ),
    max_leaves=8,
)


def check(payload: bytes, schema: type[Message]) -> None:
    """Decode; a message that comes out must be one that goes in again."""
    try:
        message = decode(payload, schema)
    except SchemaError:
        return
    for name in schema.model_fields:
        value = getattr(message, name)
        if isinstance(value, np.ndarray):
            assert np.isfinite(value).all()
    again = decode(encode(message, message.header), schema)
    assert encode(again, again.header) == encode(message, message.header)


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.__name__)
@many
@given(data=st.data())
def test_any_value_in_any_field(schema: type[Message], data: st.DataObject) -> None:
    fields: dict[Any, Any] = msgpack.unpackb(encode(EXAMPLES[schema], HEADER))
    names = st.sampled_from([*fields, "unknown"])
    for name in data.draw(st.lists(names, min_size=1, max_size=3)):
        if name == "header" and data.draw(st.booleans()):
            key = data.draw(st.sampled_from([*fields["header"], "unknown"]))
            fields["header"][key] = data.draw(values)
        else:
            fields[name] = data.draw(values)
            if name == "header":
                break
    check(msgpack.packb(fields), schema)


@pytest.mark.parametrize("schema", SCHEMAS, ids=lambda schema: schema.__name__)
@many
@given(data=st.data())
def test_damaged_payloads(schema: type[Message], data: st.DataObject) -> None:
    payload = bytearray(encode(EXAMPLES[schema], HEADER))
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(payload) - 1))
        payload[position] = data.draw(st.integers(0, 255))
    check(bytes(payload), schema)


@many
@given(payload=st.binary(max_size=300), schema=st.sampled_from(SCHEMAS))
def test_random_bytes(payload: bytes, schema: type[Message]) -> None:
    check(payload, schema)


@many
@given(value=values, schema=st.sampled_from(SCHEMAS))
def test_random_msgpack(value: object, schema: type[Message]) -> None:
    check(msgpack.packb(value), schema)
