"""A reader follows one sender of an exclusive topic, whatever another one sends."""

import logging
import random

import pytest

from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.journal.journal import Journal
from common.journal.tables import INPUT_COLUMNS, InputOutcome, read_tables
from common.links.config import Links
from common.schemas import Header, PlantState
from common.topics import ALL_TOPICS, PLANT_STATE
from common.wire.codec import encode
from tests.common.transport.support import plant_state

MS = 1_000_000
SILENCE = round(1e9 * PLANT_STATE.max_age)
START = 1000 * MS


def state(seq: int, boot: int, at_ns: int, source: str = "sim") -> bytes:
    header = Header(seq=seq, boot=boot, source=source, sent=at_ns)
    return encode(plant_state(), header)


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR, logger="common.inbox.buffer")


def shown(inbox: Inbox) -> int:
    """Boot id of the state that is seen; 0: none."""
    value: PlantState | None = inbox.latest(PLANT_STATE)
    return 0 if value is None else value.header.boot


def test_every_exclusive_topic_has_a_silence_after_which_another_is_followed() -> None:
    for topic in ALL_TOPICS:
        assert not topic.exclusive or topic.max_age <= 1.0


def test_the_second_plant_is_not_seen_and_named() -> None:
    inbox = Inbox((PLANT_STATE,))
    for number in range(400):
        at = START + number * 5 * MS
        inbox.offer("plant/state", state(number, 0xA1, at), at)
        inbox.offer("plant/state", state(number, 0xB2, at, "plant"), at + MS)
        inbox.begin_step(at + 2 * MS)
        assert shown(inbox) == 0xA1
    health = inbox.health_of(PLANT_STATE)
    assert (health.foreign, health.refused, health.gaps, health.late) == (400, 0, 0, 0)
    assert "from plant boot b2, following sim boot a1" in health.last_refusal
    assert set(inbox.latest_by_sender(PLANT_STATE)) == {("sim", 0xA1)}


@pytest.mark.parametrize(("silent_ms", "follows"), [(99, 1), (100, 1), (101, 2)])
def test_another_is_followed_after_a_silence_of_max_age(silent_ms: int, follows: int) -> None:
    inbox = Inbox((PLANT_STATE,))
    inbox.offer("plant/state", state(0, 1, START), START)
    at = START + silent_ms * MS
    inbox.offer("plant/state", state(0, 2, at), at)
    inbox.begin_step(at)
    assert shown(inbox) == follows


def test_a_restarted_sender_is_seen_again_within_max_age() -> None:
    inbox = Inbox((PLANT_STATE,), max_age={"plant/state": 0.3})
    seen = []
    for number in range(200):
        at = START + number * 5 * MS
        boot = 1 if number < 100 else 2
        inbox.offer("plant/state", state(number % 100, boot, at), at)
        inbox.begin_step(at)
        seen.append(shown(inbox))
    # The last of the first life came with number 99; 0.3 s later the second life is followed.
    assert seen.index(2) == 99 + 300 // 5 + 1
    assert inbox.health_of(PLANT_STATE).gaps == 0


def test_jitter_and_loss_of_a_link_make_no_silence() -> None:
    """What counts is when a message came to this host, not when the link lets it through."""
    links = Links.from_table({"plant/state": "normal(122ms, 190ms) loss=10%"}, ["wbc"])
    inbox = Inbox((PLANT_STATE,), service="wbc", links=links, seed=3)
    rng = random.Random(1)
    seen = set()
    for number in range(2000):
        at = START + number * 5 * MS
        # Both come in any order.
        for boot in rng.sample((1, 2), 2) if number else (1, 2):
            inbox.offer("plant/state", state(number, boot, at), at)
        inbox.begin_step(at)
        seen.add(shown(inbox))
    assert len(seen - {0}) == 1
    assert inbox.health_of(PLANT_STATE).foreign > 1500


def test_old_messages_keep_their_sender_but_make_nobody_followed() -> None:
    inbox = Inbox((PLANT_STATE,))
    inbox.offer("plant/state", state(0, 2, START - 2 * SILENCE), START)
    inbox.offer("plant/state", state(0, 1, START), START)
    for number in range(1, 100):
        at = START + number * 5 * MS
        inbox.offer("plant/state", state(number, 1, at - 2 * SILENCE), at)
        inbox.offer("plant/state", state(number, 2, at), at)
        inbox.begin_step(at)
    health = inbox.health_of(PLANT_STATE)
    assert shown(inbox) == 1
    assert (health.stale, health.foreign) == (100, 99)


def test_the_journal_says_what_was_not_followed() -> None:
    journal = Journal("wbc", {})
    inbox = Inbox((PLANT_STATE,), context=InboxContext(journal=journal))
    for boot in (1, 2):
        inbox.offer("plant/state", state(0, boot, START), START)
    inbox.begin_step(START)
    journal.end_step(START)
    message = journal.fetch()
    assert message is not None
    outcomes = read_tables(message)[1][:, INPUT_COLUMNS.index("outcome")]
    assert outcomes.tolist() == [InputOutcome.APPLIED, InputOutcome.FOREIGN]
