"""Headers read off the wire, and the counts built on them."""

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.bus.codec import encode
from common.bus.wire import wire_header
from common.schemas import Gait, GaitRequest, Header
from services.logger.errors import LoggerError
from services.logger.tally import (
    KeyCount,
    Tally,
    format_report,
    from_metadata,
    to_metadata,
)


def test_header_of_a_real_message() -> None:
    header = Header(seq=7, stamp=1, sent=123_456_789_000, boot=2**62, source="x")
    payload = encode(GaitRequest(request_id=1, gait=Gait.FORWARD), header)
    assert wire_header(payload) == header


def test_header_is_found_wherever_it_stands() -> None:
    payload = msgpack.packb({"data": bytes(5000), "n": [1, {"a": 2}], "header": {"seq": 3}})
    assert wire_header(payload) == Header(seq=3)


@pytest.mark.parametrize(
    "payload",
    [
        b"",
        b"\xc1",
        b"hello",
        msgpack.packb([1, 2]),
        msgpack.packb({"header": 3}),
        msgpack.packb({"header": {"seq": "1"}}),
        msgpack.packb({"header": {"seq": -1}}),
        msgpack.packb({"other": 1}),
        msgpack.packb({"data": bytes(100), "header": {"seq": 1}})[:50],
    ],
)
def test_no_header_is_no_error(payload: bytes) -> None:
    assert wire_header(payload) is None


@given(st.binary(max_size=200))
def test_any_bytes_are_survived(payload: bytes) -> None:
    wire_header(payload)


def test_gaps_by_key_and_boot() -> None:
    tally = Tally()
    for seq in (5, 6, 9, 8, 10):  # starts late, loses 7; 8 comes late
        tally.record("a", Header(seq=seq, boot=1))
    for seq in (0, 1):
        tally.record("a", Header(seq=seq, boot=2))
    tally.record("b", None)
    report = tally.report({"a": 4, "c": 1})
    assert report["a"] == KeyCount(recorded=7, dropped=4, gaps=1)
    assert report["b"] == KeyCount(recorded=1, headerless=1)
    assert report["c"] == KeyCount(dropped=1)


def test_report_survives_the_file_and_reads_well() -> None:
    report = {"x/a": KeyCount(3, 2, 1, 0), "x/b": KeyCount(10, 0, 0, 5)}
    assert from_metadata(to_metadata(report)) == report
    total = format_report(report).splitlines()[-1].split()
    assert total == ["total", "13", "2", "1", "5"]
    with pytest.raises(LoggerError, match="counts by topic"):
        from_metadata({"a": "not json"})
