"""The journal's rows, what is kept when nobody listens, and the sums of the ledger."""

from typing import Any

import numpy as np
import pytest

from common.errors import SchemaError
from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.journal.journal import Journal
from common.journal.stages import stage_times
from common.journal.tables import (
    INPUT_COLUMNS,
    UNKNOWN,
    InputOutcome,
    InputTimes,
    read_tables,
)
from common.links.config import Links
from common.schemas import Header, StepJournal
from common.topics import PLANT_STATE, TELEOP_GAIT
from common.wire.codec import decode, encode
from tests.common.transport.support import plant_state

MS = 1_000_000
SECOND = 1_000_000_000


class Reader:
    """An inbox with a journal whose sender's clock is ahead by 200 ms."""

    def __init__(self, link: str = "") -> None:
        self.now = 10 * SECOND
        self.journal = Journal("wbc", {"rate": 100})
        self.decoding = 0
        context = InboxContext(lambda _header: -200 * MS, self._clock, self.journal)
        links = Links.from_table({"plant/state": link} if link else {}, ["wbc"])
        self.inbox = Inbox((PLANT_STATE, TELEOP_GAIT), service="wbc", links=links, context=context)
        self.seq = 0

    def _clock(self) -> int:
        self.decoding += MS // 2  # each decoding inputs half a millisecond
        return self.now + self.decoding

    def offer(self, *, wire_ms: float = 3.0, garbage: bool = False, seq: int | None = None) -> None:
        """A state arrives now: captured 2 ms, encoded in 1 ms before it was sent."""
        sent = self.now - round(wire_ms * MS) + 200 * MS
        header = Header(
            seq=self.seq if seq is None else seq,
            captured=sent - 3 * MS,
            sent=sent,
            encode=MS,
            boot=7,
            source="sim",
        )
        self.seq += 1
        payload = encode(plant_state(), header)
        self.inbox.offer("plant/state", payload[:-3] if garbage else payload, self.now)

    def step(self, *, after_ms: float = 4.0, used_ms: float = 5.0) -> None:
        self.now += round(after_ms * MS)
        self.inbox.begin_step(self.now)
        self.now += round(used_ms * MS)
        self.journal.end_step(self.now)

    def fetch(self) -> tuple[StepJournal, list[dict[str, int]]]:
        message = self.journal.fetch()
        assert message is not None
        again = decode(encode(message, Header()), StepJournal)
        _, inputs = read_tables(again)
        return message, [dict(zip(INPUT_COLUMNS, map(int, row), strict=True)) for row in inputs]


def stages(reader: Reader) -> dict[str, tuple[float, float]]:
    (link, _) = reader.inbox.link_health()
    return {each.stage: (1e3 * each.median, 1e3 * each.p99) for each in link.stages}


def test_the_ways_stages_add_up_to_the_total() -> None:
    reader = Reader()
    reader.offer()
    reader.step()
    found = stages(reader)
    expected = {
        "capture": 2.0,
        "encode": 1.0,
        "wire": 3.0,
        "injected": 0.0,
        "queue": 4.0,
        "decode": 0.5,
        "use": 5.0,
        "total": 15.0,
    }
    assert {name: median for name, (median, _) in found.items()} == pytest.approx(expected)
    # Decoding happens in the step that uses the message, so it is part of its use.
    parts = [value for name, value in expected.items() if name not in {"total", "decode"}]
    assert sum(parts) == expected["total"]


def test_injected_delay_is_told_from_the_queue() -> None:
    reader = Reader("40ms")
    reader.offer()
    reader.step(after_ms=43.0)
    found = stages(reader)
    assert found["injected"][0] == pytest.approx(40.0)
    assert found["queue"][0] == pytest.approx(3.0)
    assert found["wire"][0] == pytest.approx(3.0)
    assert found["total"][0] == pytest.approx(2 + 1 + 3 + 40 + 3 + 5)


def test_rows_say_what_became_of_each_message() -> None:
    reader = Reader()
    reader.offer()
    reader.offer(seq=0)  # repeated
    reader.offer(wire_ms=150.0)  # older than a state may be
    reader.offer(garbage=True)
    reader.step()
    reader.offer(seq=9)
    reader.step()
    message, rows = reader.fetch()
    # What has no readable header cannot be named, and is only counted by the inbox.
    kinds = [row["outcome"] for row in rows]
    assert kinds[:3] == [InputOutcome.APPLIED, InputOutcome.LATE, InputOutcome.STALE]
    assert kinds[-1] == InputOutcome.APPLIED
    assert [row["step"] for row in rows][-1] == 1
    assert (message.first_step, message.service) == (0, "wbc")
    assert [(s.topic, s.source, s.boot) for s in message.sources] == [("plant/state", "sim", 7)]
    assert rows[-1]["seq"] == 9
    assert rows[-1]["offset"] == -200 * MS
    assert sum(row["size"] for row in rows) == len(message.payloads)
    assert message.settings
    reader.step()
    later, rows = reader.fetch()
    assert (later.first_step, rows, later.settings) == (2, [], "")


def test_what_a_link_loses_is_noted_too() -> None:
    reader = Reader("1ms loss=100%")
    reader.offer()
    reader.step()
    _, (row,) = reader.fetch()
    assert (row["outcome"], row["injected"]) == (InputOutcome.LOST, -1)
    assert stages(reader) == {}


def test_an_unknown_clock_leaves_out_wire_and_total() -> None:
    rows = np.array([[0, 3, 1, 9, 2, UNKNOWN, 1, 12, 20], [0, 3, 1, 9, 2, UNKNOWN, 1, 12, 20]])
    assert [each.stage for each in stage_times(rows)] == [
        "capture",
        "encode",
        "injected",
        "queue",
        "decode",
        "use",
    ]
    rows[1, 5] = 4
    found = {each.stage: each.median for each in stage_times(rows)}
    assert found["wire"] == pytest.approx((9 - 3 - 4) * 1e-9)
    assert found["total"] == pytest.approx((20 - 0 - 4) * 1e-9)


def test_percentiles_are_order_statistics() -> None:
    rows = np.zeros((200, 9), np.int64)
    rows[:, 6] = np.arange(1, 201) * MS
    decoded = next(each for each in stage_times(rows) if each.stage == "decode")
    assert (decoded.median, decoded.p99) == pytest.approx((0.101, 0.199))


def test_only_the_last_seconds_count_in_health() -> None:
    reader = Reader()
    reader.offer(wire_ms=90.0)
    reader.step()
    reader.now += 3 * SECOND
    reader.offer(wire_ms=3.0)
    reader.step()
    assert stages(reader)["wire"] == pytest.approx((3.0, 3.0))


@pytest.mark.parametrize(
    "damage",
    [
        {"steps": bytes(15)},
        {"inputs": bytes(95)},
        {"sources": []},
        {"steps": b""},
        {"payloads": b"abc"},
    ],
)
def test_tables_that_contradict_themselves_are_refused(damage: dict[str, Any]) -> None:
    reader = Reader()
    reader.offer()
    reader.step()
    message, _ = reader.fetch()
    damaged = message.model_copy(update=damage)
    with pytest.raises(SchemaError, match=r"contradicts itself|rows of|refer"):
        read_tables(damaged)


def test_a_header_beyond_the_columns_is_refused_and_stops_nothing() -> None:
    reader = Reader()
    for field in ("seq", "captured", "sent", "encode", "boot"):
        header = Header().model_copy(update={field: 2**63, "source": "sim"})
        reader.inbox.offer("plant/state", encode(plant_state(), header), reader.now)
    reader.offer()
    reader.step()
    _, rows = reader.fetch()
    assert [row["outcome"] for row in rows] == [InputOutcome.APPLIED]
    assert reader.inbox.health_of(PLANT_STATE).refused == 5
    assert stages(reader)["total"]


def test_a_payload_too_long_to_carry_is_not_carried() -> None:
    reader = Reader()
    header = Header(seq=1, sent=reader.now, boot=7, source="sim")
    long = encode(plant_state(), header)
    # One entry more than the schema has: refused, but its header is readable.
    entries = (long[0] & 0x0F) + 1
    long = b"\xde" + entries.to_bytes(2, "big") + long[1:] + b"\xa1x\xc6"
    long += (33_000_000).to_bytes(4, "big")
    reader.inbox.offer("plant/state", long + bytes(33_000_000), reader.now)
    reader.offer(seq=2)
    reader.step()
    message, rows = reader.fetch()
    assert [(row["outcome"], row["size"] > 0) for row in rows] == [
        (InputOutcome.REFUSED, False),
        (InputOutcome.APPLIED, True),
    ]
    assert len(message.payloads) == rows[1]["size"]


def test_too_many_messages_between_two_fetches_are_counted() -> None:
    journal = Journal("wbc")
    journal.begin_step(1)
    for seq in range(40_010):
        header = Header(seq=seq, source="sim", boot=7)
        journal.record("plant/state", InputOutcome.APPLIED, header, b"", "", InputTimes(1, 0, 0, 0))
    journal.end_step(2)
    message = journal.fetch()
    assert message is not None
    assert (message.lost, len(read_tables(message)[1])) == (10, 40_000)


def test_the_first_seconds_of_each_senders_life_are_carried() -> None:
    journal = Journal("sim")
    sizes: dict[int, list[bool]] = {1: [], 2: []}
    for tenth in range(300):
        now = tenth * SECOND // 10
        boot = 1 if tenth < 200 else 2
        journal.begin_step(now)
        header = Header(seq=tenth, boot=boot, source="wbc")
        journal.record(
            "wbc/command", InputOutcome.APPLIED, header, bytes(10), "", InputTimes(now, 0, 0, 0)
        )
        journal.end_step(now)
        message = journal.fetch()
        assert message is not None
        sizes[boot].append(len(message.payloads) == 10)
    assert sizes[1] == [True] * 51 + [False] * 149
    assert sizes[2] == [True] * 51 + [False] * 49
    # Bounded whoever sends however much.
    carried = 0
    for boot in range(3, 300):
        header = Header(boot=boot, source="wbc")
        journal.begin_step(1)
        for _ in range(3):
            journal.record(
                "wbc/command",
                InputOutcome.APPLIED,
                header,
                bytes(3_000_000),
                "",
                InputTimes(1, 0, 0, 0),
            )
        if boot % 3 == 0:
            message = journal.fetch()
            assert message is not None
            assert len(message.payloads) <= 8_000_000
            carried += len(message.payloads)
    assert 0 < carried <= 62 * 8_000_000
