"""Sequence numbers tell what went missing, stream by stream."""

import random

import pytest

from common.schemas import Header
from common.wire.sequence import MAX_JUMP, MessageOrder, SequenceTracker


def header(seq: int, boot: int = 1, source: str = "sim") -> Header:
    return Header(seq=seq, boot=boot, source=source)


def test_consecutive_numbers_miss_nothing() -> None:
    tracker = SequenceTracker()
    assert [tracker.observe(header(seq)) for seq in (5, 6, 7)] == [MessageOrder.NEXT] * 3
    assert tracker.missing == 0


def test_gaps_are_counted_and_filled_by_late_ones() -> None:
    tracker = SequenceTracker()
    tracker.observe(header(0))
    assert tracker.observe(header(4)) is MessageOrder.NEXT
    assert tracker.missing == 3
    assert tracker.observe(header(2)) is MessageOrder.LATE
    assert tracker.missing == 2
    assert tracker.observe(header(4)) is MessageOrder.REPEATED
    assert tracker.missing == 2


def test_a_repeat_of_an_older_message_fills_no_gap() -> None:
    tracker = SequenceTracker()
    for seq in (0, 1, 2, 5):
        tracker.observe(header(seq))
    # 1 comes again; 3 was overtaken by 5; then 3 comes again too.
    orders = [tracker.observe(header(seq)) for seq in (1, 3, 3)]
    assert orders == [MessageOrder.REPEATED, MessageOrder.LATE, MessageOrder.REPEATED]
    assert (tracker.missing, tracker.late, tracker.repeated) == (1, 1, 2)


def test_what_came_before_the_first_seen_is_late_and_fills_nothing() -> None:
    tracker = SequenceTracker()
    for seq in (10, 12):
        tracker.observe(header(seq))
    assert tracker.observe(header(9)) is MessageOrder.LATE
    assert (tracker.missing, tracker.late) == (1, 1)


def test_shuffled_and_doubled_streams_are_told_apart() -> None:
    order = list(range(300))
    draw = random.Random(7)
    for start in range(10, 300, 10):
        part = order[start : start + 10]
        draw.shuffle(part)
        order[start : start + 10] = part
    order = [order[0], *[seq for seq in order[1:] for _ in range(1 + (seq % 5 == 0))]]
    tracker = SequenceTracker()
    seen: set[int] = set()
    for seq in order:
        order_found = tracker.observe(header(seq))
        assert (order_found is MessageOrder.REPEATED) == (seq in seen)
        seen.add(seq)
    assert tracker.missing == 0
    assert tracker.repeated == len(order) - 300
    assert tracker.late > 100


def test_memory_of_the_missing_is_bounded() -> None:
    tracker = SequenceTracker()
    for seq in range(0, 20_000, 2):
        tracker.observe(header(seq))
    # Of the 10,000 missing numbers no more than the last thousand are remembered.
    assert tracker.observe(header(19_997 - 2 * 1024)) is MessageOrder.LATE
    assert tracker.observe(header(19_997 - 2 * 1024)) is MessageOrder.LATE
    for seq in (900_000, 900_001):
        tracker.observe(header(seq))
    assert tracker.observe(header(899_990)) is MessageOrder.LATE
    assert tracker.observe(header(899_990)) is MessageOrder.REPEATED
    assert tracker.observe(header(3)) is MessageOrder.LATE
    assert tracker.missing == 9_999 + 880_001 - 1


def test_restart_and_second_source_are_runs_of_their_own() -> None:
    tracker = SequenceTracker()
    for each in (header(0), header(1), header(0, boot=2), header(9, source="other")):
        assert tracker.observe(each) is MessageOrder.NEXT
    tracker.observe(header(2, boot=1))
    tracker.observe(header(12, source="other"))
    assert tracker.missing == 2


def test_what_arrived_undecoded_is_not_missing() -> None:
    tracker = SequenceTracker()
    tracker.observe(header(0))
    tracker.discount(2)
    tracker.observe(header(5))
    assert tracker.missing == 2
    tracker.observe(header(7))
    assert tracker.missing == 3


def test_an_implausible_number_is_not_believed_alone() -> None:
    tracker = SequenceTracker()
    tracker.observe(header(0))
    assert tracker.observe(header(2**62)) is MessageOrder.IMPLAUSIBLE
    # What comes after it is not shut out.
    assert tracker.observe(header(1)) is MessageOrder.NEXT
    assert tracker.missing == 0


def test_one_stray_number_spoils_neither_account_nor_order() -> None:
    """98,722 numbers ahead: it came once, and the stream goes on as before."""
    tracker = SequenceTracker()
    orders = [tracker.observe(header(seq)) for seq in (*range(100), 98_821, *range(100, 300))]
    assert orders.count(MessageOrder.NEXT) == 300
    assert orders[100] is MessageOrder.IMPLAUSIBLE
    assert (tracker.missing, tracker.late, tracker.repeated) == (0, 0, 0)


@pytest.mark.parametrize("gap", [MAX_JUMP + 1, 3_000_000])
def test_a_long_gap_is_believed_when_it_goes_on(gap: int) -> None:
    tracker = SequenceTracker()
    tracker.observe(header(0))
    assert tracker.observe(header(gap)) is MessageOrder.IMPLAUSIBLE
    # The link still loses some, and another sender's gap in between changes nothing.
    tracker.observe(header(0, boot=2))
    assert tracker.observe(header(2 * gap, boot=2)) is MessageOrder.IMPLAUSIBLE
    assert tracker.observe(header(gap + 3)) is MessageOrder.NEXT
    assert tracker.observe(header(gap + 4)) is MessageOrder.NEXT
    assert tracker.missing == gap + 1
    assert tracker.observe(header(5)) is MessageOrder.LATE


def test_many_runs_stay_bounded() -> None:
    tracker = SequenceTracker()
    for boot in range(2, 1000):
        tracker.observe(header(0, boot=boot))
    # The oldest are forgotten: what comes of them again begins anew, of the newest it is repeated.
    assert tracker.observe(header(0, boot=999)) is MessageOrder.REPEATED
    assert tracker.observe(header(0, boot=999 - 63)) is MessageOrder.REPEATED
    assert tracker.observe(header(0, boot=999 - 64)) is MessageOrder.NEXT
