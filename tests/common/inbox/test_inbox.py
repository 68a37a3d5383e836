"""What a service sees of its inputs: newest good value, every event, honest counters."""

import logging
import math

import pytest

from common.errors import TrillError
from common.inbox.arrivals import EVENT_BACKLOG, LATEST_BACKLOG
from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.journal.journal import Journal
from common.schemas import Estop, Gait, GaitRequest, Header, JointCommand, PlantState
from common.topics import ESTOP, HEALTH, PLANT_STATE, TELEOP_GAIT, WBC_COMMAND, Topic
from common.wire.codec import encode, schema_hash, schema_tag
from tests.common.transport.support import example_of, health, plant_state

MS = 1_000_000
TOPICS: tuple[Topic[PlantState], Topic[GaitRequest]] = (PLANT_STATE, TELEOP_GAIT)


def state(seq: int, boot: int = 1) -> bytes:
    message = plant_state(seq, boot)
    return encode(message, message.header)


def gait(seq: int, boot: int = 1) -> bytes:
    header = Header(seq=seq, boot=boot, source="teleop")
    return encode(GaitRequest(request_id=seq, gait=Gait.FORWARD), header)


def seq(inbox: Inbox) -> int:
    value = inbox.latest(PLANT_STATE)
    assert value is not None
    return value.header.seq


@pytest.fixture(autouse=True)
def _quiet(caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level(logging.ERROR, logger="common.inbox.buffer")


def test_nothing_before_the_first_message() -> None:
    inbox = Inbox(TOPICS)
    inbox.begin_step(0)
    assert inbox.latest(PLANT_STATE) is None
    assert not inbox.updated(PLANT_STATE)
    assert not inbox.fresh(PLANT_STATE)
    assert inbox.age(PLANT_STATE) == math.inf
    assert inbox.events(TELEOP_GAIT) == []
    assert inbox.health_of(PLANT_STATE).age == -1.0
    assert inbox.link_health()[0] == inbox.health_of(PLANT_STATE)


def test_a_step_is_a_snapshot() -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", state(0), 0)
    assert inbox.latest(PLANT_STATE) is None
    inbox.begin_step(MS)
    assert seq(inbox) == 0
    inbox.offer("plant/state", state(1), MS)
    assert seq(inbox) == 0
    inbox.begin_step(2 * MS)
    assert seq(inbox) == 1


def test_updated_lasts_one_step_and_the_value_stays() -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", state(0), 0)
    inbox.begin_step(MS)
    assert inbox.updated(PLANT_STATE)
    inbox.begin_step(2 * MS)
    assert not inbox.updated(PLANT_STATE)
    assert seq(inbox) == 0


def test_latest_shows_only_the_newest_but_counts_all() -> None:
    inbox = Inbox(TOPICS)
    for number in (0, 1, 2, 5):
        inbox.offer("plant/state", state(number), number * MS)
    inbox.begin_step(6 * MS)
    assert seq(inbox) == 5
    status = inbox.health_of(PLANT_STATE)
    assert (status.received, status.gaps, status.refused, status.skipped) == (4, 2, 0, 0)


def test_garbage_last_leaves_the_newest_good_value() -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", state(0), 1 * MS)
    inbox.offer("plant/state", state(1), 2 * MS)
    inbox.offer("plant/state", b"garbage", 3 * MS)
    inbox.begin_step(4 * MS)
    assert seq(inbox) == 1
    assert inbox.updated(PLANT_STATE)
    assert inbox.age(PLANT_STATE) == pytest.approx(0.002)
    status = inbox.health_of(PLANT_STATE)
    assert (status.received, status.refused) == (3, 1)
    assert "PlantState" in status.last_refusal
    inbox.offer("plant/state", state(3), 5 * MS)
    inbox.begin_step(6 * MS)
    # Number 2 was the garbage: refused, not missing.
    assert inbox.health_of(PLANT_STATE).gaps == 0


def test_only_garbage_updates_nothing() -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", b"", MS)
    inbox.begin_step(MS)
    assert not inbox.updated(PLANT_STATE)
    assert inbox.latest(PLANT_STATE) is None
    assert inbox.health_of(PLANT_STATE).received == 1


def test_wrong_schema_tag_is_refused_with_both_names() -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", state(0), 0, schema_tag(Estop))
    inbox.begin_step(0)
    status = inbox.health_of(PLANT_STATE)
    assert status.refused == 1
    assert f"trill/Estop/1;{schema_hash(Estop)}" in status.last_refusal
    assert f"trill/PlantState/1;{schema_hash(PlantState)}" in status.last_refusal


def test_fresh_and_age_follow_the_last_good_message() -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", state(0), 0)
    limit = round(PLANT_STATE.max_age * 1e9)
    inbox.begin_step(limit)
    assert inbox.fresh(PLANT_STATE)
    assert inbox.age(PLANT_STATE) == pytest.approx(PLANT_STATE.max_age)
    inbox.offer("plant/state", b"garbage", limit)
    inbox.begin_step(limit + 1)
    assert not inbox.fresh(PLANT_STATE)


def test_rate_is_that_of_the_last_second() -> None:
    inbox = Inbox(TOPICS)
    period = round(1e9 / PLANT_STATE.rate)
    for number in range(400):
        inbox.offer("plant/state", state(number), number * period)
        inbox.begin_step(number * period)
    assert inbox.health_of(PLANT_STATE).rate == PLANT_STATE.rate
    inbox.begin_step(399 * period + 500 * MS)
    assert inbox.health_of(PLANT_STATE).rate == pytest.approx(PLANT_STATE.rate / 2)


def test_events_come_once_in_order() -> None:
    inbox = Inbox(TOPICS)
    for number in range(3):
        inbox.offer("teleop/gait", gait(number), number)
    inbox.begin_step(MS)
    assert [event.request_id for event in inbox.events(TELEOP_GAIT)] == [0, 1, 2]
    assert [event.request_id for event in inbox.events(TELEOP_GAIT)] == [0, 1, 2]
    assert inbox.updated(TELEOP_GAIT)
    inbox.begin_step(2 * MS)
    assert inbox.events(TELEOP_GAIT) == []
    assert not inbox.updated(TELEOP_GAIT)
    assert inbox.fresh(TELEOP_GAIT)


def test_repeated_event_is_given_once_and_a_late_one_still() -> None:
    inbox = Inbox(TOPICS)
    for number in (0, 2, 2, 1):
        inbox.offer("teleop/gait", gait(number), 0)
    inbox.begin_step(0)
    assert [event.request_id for event in inbox.events(TELEOP_GAIT)] == [0, 2, 1]
    status = inbox.health_of(TELEOP_GAIT)
    assert (status.late, status.repeated, status.gaps) == (1, 1, 0)
    assert inbox.health_of(TELEOP_GAIT).gaps == 0


def test_overtaken_state_is_not_shown() -> None:
    inbox = Inbox(TOPICS)
    for number in (0, 3, 2):
        inbox.offer("plant/state", state(number), number)
        inbox.begin_step(number)
    assert seq(inbox) == 3
    assert not inbox.updated(PLANT_STATE)
    status = inbox.health_of(PLANT_STATE)
    assert (status.late, status.gaps) == (1, 1)


def test_restarted_publisher_begins_anew() -> None:
    inbox = Inbox((WBC_COMMAND,))
    for number, boot in ((500, 1), (0, 2)):
        header = Header(seq=number, boot=boot, source="wbc")
        inbox.offer("wbc/command", encode(example_of(JointCommand), header), MS)
        inbox.begin_step(MS)
        assert inbox.updated(WBC_COMMAND)
    assert inbox.health_of(WBC_COMMAND).gaps == 0


@pytest.mark.parametrize(
    ("topic", "make", "bound"),
    [(PLANT_STATE, state, LATEST_BACKLOG), (TELEOP_GAIT, gait, EVENT_BACKLOG)],
)
def test_backlog_is_bounded_and_counted(topic: Topic[PlantState], make: object, bound: int) -> None:
    assert callable(make)
    inbox = Inbox(TOPICS)
    inbox.offer(topic.name, make(0), 0)
    inbox.begin_step(0)
    for number in range(1, bound + 11):
        inbox.offer(topic.name, make(number), number)
    inbox.begin_step(MS)
    health = inbox.health_of(topic)
    assert health.skipped == 10
    assert health.received == bound + 11
    assert health.gaps == 0
    if topic is not PLANT_STATE:
        assert [event.header.seq for event in inbox.events(topic)] == list(range(11, bound + 11))


def test_per_source_topics_keep_each_source() -> None:
    inbox = Inbox((HEALTH,))
    for source in ("sim", "wbc"):
        message = health(source)
        inbox.offer("health", encode(message, Header(seq=4, boot=1, source=source)), 0)
    inbox.begin_step(0)
    assert {key.source: value.service for key, value in inbox.latest_by_sender(HEALTH).items()} == {
        "sim": "sim",
        "wbc": "wbc",
    }
    assert inbox.health_of(HEALTH).gaps == 0


def test_a_topic_not_read_is_an_error_that_says_how_to_mend_it() -> None:
    inbox = Inbox(TOPICS)
    with pytest.raises(TrillError, match=r"'wbc/command' is not among.*plant/state.*`reads`"):
        inbox.latest(WBC_COMMAND)


def test_trigger_wakes_and_tells_its_arrival_once() -> None:
    inbox = Inbox(TOPICS, trigger=PLANT_STATE)
    assert not inbox.wait(0.0)
    assert inbox.trigger_arrival(0) is None
    inbox.offer("teleop/gait", gait(0), 5)
    assert not inbox.wait(0.0)
    inbox.offer("plant/state", state(0), 7)
    assert inbox.wait(0.0)
    assert inbox.trigger_arrival(8) == 7
    assert inbox.trigger_arrival(9) is None
    assert not inbox.wait(0.0)


def test_estop_passes_whatever_else_arrives() -> None:
    inbox = Inbox((PLANT_STATE, ESTOP))
    for number in range(1000):
        inbox.offer("plant/state", state(number) if number % 2 else b"junk", number)
    inbox.offer("estop", encode(Estop(reason="stop"), Header(source="teleop")), 1000)
    inbox.begin_step(1000)
    assert [event.reason for event in inbox.events(ESTOP)] == ["stop"]


def test_a_flood_does_not_keep_a_step_from_ending() -> None:
    came = 0

    def clock() -> int:
        """While one message is decoded, the next arrives."""
        nonlocal came
        came += 1
        if came < 1000:
            inbox.offer("plant/state", state(came), came)
        return came

    inbox = Inbox(TOPICS, context=InboxContext(clock=clock, journal=Journal("wbc")))
    inbox.offer("plant/state", state(0), 0)
    inbox.begin_step(1)
    assert inbox.health_of(PLANT_STATE).received == 1
    inbox.begin_step(2)
    assert seq(inbox) > 0
