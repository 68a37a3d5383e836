"""Headers read off the wire, and the counts built on them."""

import msgpack
import pytest
from hypothesis import given
from hypothesis import strategies as st

from common.schemas import Gait, GaitRequest, Header
from common.wire.codec import encode
from common.wire.header import wire_header
from services.logger.errors import LoggerError
from services.logger.read.delivery import (
    MAX_STREAMS,
    DeliveryCount,
    DeliveryStats,
    format_report,
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


def numbered(stats: DeliveryStats, seqs: list[int], boot: int = 1, key: str = "a") -> None:
    for seq in seqs:
        stats.record(key, Header(seq=seq, boot=boot, source="s"), size=10, at_ns=1000 + seq)


def dropped(stats: DeliveryStats, seqs: list[int], boot: int = 1, key: str = "a") -> None:
    drops = DeliveryStats()
    for seq in seqs:
        drops.drop(key, Header(seq=seq, boot=boot, source="s"))
    stats.add_drops(drops)


def test_sent_is_recorded_and_lost_and_dropped_by_key_and_boot() -> None:
    stats = DeliveryStats()
    numbered(stats, [5, 6, 9, 8, 10, 10])  # starts late, loses 7; 8 comes late, 10 twice
    numbered(stats, [0, 1], boot=2)
    dropped(stats, [11, 12])
    stats.record("b", None)
    stats.drop("c", None)
    report = stats.report()
    a = report["a"]
    assert (a.sent, a.recorded, a.lost, a.dropped) == (8 + 2, 5 + 2, 1, 2)
    assert (a.repeated, a.late, a.earlier, a.bytes) == (1, 1, 5, 80)
    assert (report["b"].sent, report["b"].recorded, report["b"].headerless) == (1, 1, 1)
    assert (report["c"].sent, report["c"].recorded, report["c"].dropped) == (1, 0, 1)


def test_a_message_dropped_once_and_recorded_once_is_recorded() -> None:
    stats = DeliveryStats()
    dropped(stats, [1, 2])
    numbered(stats, [0, 2, 3])
    count = stats.report()["a"]
    assert (count.sent, count.recorded, count.lost, count.dropped) == (4, 3, 0, 1)


def test_a_wild_number_is_no_million_lost_ones() -> None:
    stats = DeliveryStats()
    numbered(stats, [0, 1, 2**60, 2])
    dropped(stats, [2**61])
    count = stats.report()["a"]
    assert (count.sent, count.lost, count.headerless) == (3 + 1 + 1, 0, 1)


def test_one_stray_message_adds_no_gaps() -> None:
    """98,722 numbers too far, in the file all the same; then 2,000 real ones are lost."""
    stats = DeliveryStats()
    numbered(stats, [*range(100), 98_821, *range(100, 300)])
    for _ in range(2):
        count = stats.report()["a"]
        assert (count.recorded, count.lost, count.headerless) == (301, 0, 1)
        stats = DeliveryStats.from_metadata(stats.to_metadata())
    numbered(stats, list(range(2300, 2400)))
    assert stats.report()["a"].lost == 2000
    # Before the rest, too.
    stats = DeliveryStats()
    numbered(stats, [3, *range(90_000, 90_100)])
    dropped(stats, [200_000])
    assert stats.report()["a"].lost == 0


def test_a_flood_of_streams_is_bounded() -> None:
    stats = DeliveryStats()
    for boot in range(1000):
        numbered(stats, [0], boot=boot)
    assert stats.report()["a"].sent == 1000
    assert len(stats.streams()["a"]) == MAX_STREAMS


@given(
    st.lists(
        st.tuples(st.integers(0, 40), st.sampled_from(["record", "drop", "lose"])), max_size=80
    )
)
def test_the_counts_are_exact_whatever_happens(events: list[tuple[int, str]]) -> None:
    stats = DeliveryStats()
    recorded: set[int] = set()
    drops: set[int] = set()
    for seq, what in events:
        if what == "record":
            numbered(stats, [seq])
            recorded.add(seq)
        elif what == "drop":
            dropped(stats, [seq])
            drops.add(seq)
    heard = recorded | drops
    count = stats.report().get("a", DeliveryCount())
    sent = max(heard) - min(heard) + 1 if heard else 0
    assert count.sent == sent
    assert count.recorded == len(recorded)
    assert count.dropped == len(drops - recorded)
    assert count.lost == sent - len(heard)
    again = DeliveryStats.from_metadata(stats.to_metadata())
    assert again.report() == stats.report()


def test_what_was_heard_of_before_the_damage_counts_as_sent() -> None:
    before, after = DeliveryStats(), DeliveryStats()
    numbered(before, list(range(10)))
    numbered(after, [2, 3])
    after.add_sent(before)
    count = after.report()["a"]
    assert (count.sent, count.recorded, count.lost) == (10, 2, 8)


def test_the_report_as_a_table_for_a_person() -> None:
    report = {"x/a": DeliveryCount(3, 2, 1), "x/b": DeliveryCount(10, headerless=5, earlier=4)}
    lines = format_report(report).splitlines()
    assert lines[0].split()[1:5] == ["sent", "recorded", "lost", "dropped"]
    assert lines[3].split() == ["total", "16", "13", "1", "2", "0", "0", "5"]
    assert "4 more were sent" in lines[-1]


@pytest.mark.parametrize("text", ["not json", "{}", "[1]"])
def test_damaged_metadata_are_refused(text: str) -> None:
    with pytest.raises(LoggerError, match="delivery"):
        DeliveryStats.from_metadata({"a": text})
