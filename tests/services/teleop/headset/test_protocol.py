"""What pages send: garbage is refused, and late messages are found without comparing clocks."""

import json
import math
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from services.teleop.headset.protocol import (
    Key,
    ProtocolError,
    Punctuality,
    Sample,
    parse,
    picture_message,
)

from .people import grip, message

json_values = st.recursive(
    st.none() | st.booleans() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=3) | st.dictionaries(st.text(max_size=5), inner),
    max_leaves=8,
)
SAMPLE = message(
    "sample",
    5.0,
    head=grip(0.0, 1.6, 0.0),
    left=grip(-0.2, 1.2, -0.4),
    right=grip(0.2, 1.2, -0.4, trigger=0.3, squeeze=1.0, upper=True, stick=[0.5, -1.0]),
)


def test_a_sample_is_renamed_to_the_axes_of_the_robot() -> None:
    parsed = parse(json.dumps(SAMPLE))
    assert isinstance(parsed, Sample)
    device = parsed.device_input(77)
    assert device.header.stamp == 77
    assert device.head_position.tolist() == [0.0, 0.0, 1.6]
    assert device.right.position.tolist() == [0.4, -0.2, 1.2]
    assert device.left.position.tolist() == [0.4, 0.2, 1.2]
    right = device.right
    assert (right.trigger, right.squeeze, right.upper, right.lower) == (0.3, 1.0, True, False)
    assert right.stick.tolist() == [0.5, -1.0]


@settings(deadline=None)
@given(st.text(max_size=40))
def test_texts_are_refused_in_words(text: str) -> None:
    with pytest.raises(ProtocolError, match="not a message of the page"):
        parse(text)


@settings(deadline=None, max_examples=200)
@given(st.sampled_from(["t", "type", "head", "left", "right", "more"]), json_values)
def test_damaged_samples_are_refused_and_nothing_else_is_raised(name: str, value: Any) -> None:
    damaged = {**SAMPLE, name: value}
    try:
        parsed = parse(json.dumps(damaged))
    except ProtocolError:
        return
    assert name == "t"
    assert math.isfinite(parsed.t)


@pytest.mark.parametrize(
    "fields",
    [
        {"left": grip(math.nan, 0.0, 0.0)},
        {"left": grip(1e6, 0.0, 0.0)},
        {"left": {**grip(0.0, 0.0, 0.0), "quaternion": [1.0, 1.0, 0.0, 0.0]}},
        {"left": grip(0.0, 0.0, 0.0, squeeze=1.5)},
        {"picture": 3},
    ],
)
def test_impossible_samples_are_refused(fields: dict[str, Any]) -> None:
    with pytest.raises(ProtocolError):
        parse(json.dumps({**SAMPLE, **fields}))


def test_a_key_is_a_key() -> None:
    assert parse('{"type":"key","t":1,"key":"w"}') == Key(type="key", t=1.0, key="w")


def test_lateness_is_found_whatever_the_pages_clock_is_and_however_it_drifts() -> None:
    punctuality, second = Punctuality(), 10**9
    for tick in range(100):
        at = 50 * second + tick * second // 10
        sent = 1e9 + 1e-6 * at * (1 + 1e-4)
        assert punctuality.lateness(sent, at + 20_000_000) < 0.01
    at = 61 * second
    sent = 1e9 + 1e-6 * at * (1 + 1e-4)
    assert punctuality.lateness(sent, at + 20_000_000 + second) == pytest.approx(1.0, abs=0.01)
    # A way that has become longer for good is the usual one after a while.
    for tick in range(400):
        at = 62 * second + tick * second // 10
        late = punctuality.lateness(1e9 + 1e-6 * at * (1 + 1e-4), at + 520_000_000)
    assert late < 0.01


def test_a_picture_message_can_be_taken_apart() -> None:
    data = picture_message({"number": 3}, b"left", b"right!")
    length = int.from_bytes(data[:4], "little")
    header = json.loads(data[4 : 4 + length])
    body = data[4 + length :]
    assert header["number"] == 3
    assert (body[: header["left"]], body[header["left"] :]) == (b"left", b"right!")
