"""What was held up on the way is not applied when it finally arrives, except emergency stops."""

import time
from collections.abc import Iterator, Mapping
from typing import Any

import pytest

from common.errors import ConfigError
from common.inbox.context import InboxContext
from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.journal.tables import UNKNOWN
from common.links.config import Links
from common.runtime.live.main import argument_parser, load_settings
from common.schemas import Estop, Gait, GaitRequest, Header, Message, Setpoint
from common.topics import ESTOP, PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from common.wire.codec import encode
from tests.common.transport.proxy import StallingProxy
from tests.common.transport.support import QUATERNION, VECTOR, free_base_port, plant_state

SECOND = 1_000_000_000
NOW = 5000 * SECOND
TOPICS = (TELEOP_SETPOINT, TELEOP_GAIT, ESTOP, PLANT_STATE)


def setpoint() -> Setpoint:
    return Setpoint(
        left_hand_position_in_body=VECTOR,
        left_hand_quaternion_in_body=QUATERNION,
        right_hand_position_in_body=-VECTOR,
        right_hand_quaternion_in_body=-QUATERNION,
        gripper_closure=VECTOR[:2] ** 2,
        neck_pitch=0.3,
    )


EXAMPLES: dict[str, Message] = {
    TELEOP_SETPOINT.name: setpoint(),
    TELEOP_GAIT.name: GaitRequest(request_id=1, gait=Gait.FORWARD),
    ESTOP.name: Estop(reason="test"),
}


def offered(
    topic: Topic[Any], age: float, *, seq: int = 0, clock_ahead: float = 0.0, **options: Any
) -> Inbox:
    """An inbox into which a message of this age has come at ``NOW``.

    Args:
        topic: of the message.
        age: since it was sent [s].
        seq: its number.
        clock_ahead: of the sender [s].
        options: of the inbox.
    """
    inbox = Inbox(TOPICS, service="wbc", **options)
    sent = NOW + round((clock_ahead - age) * SECOND)
    header = Header(seq=seq, sent=sent, source="teleop", boot=1)
    inbox.offer(topic.name, encode(EXAMPLES[topic.name], header), NOW)
    inbox.begin_step(NOW + SECOND)
    return inbox


@pytest.mark.parametrize(
    ("topic", "age", "applied"),
    [
        (TELEOP_GAIT, 0.49, True),
        (TELEOP_GAIT, 0.51, False),
        (TELEOP_SETPOINT, 0.24, True),
        (TELEOP_SETPOINT, 0.26, False),
        (ESTOP, 0.1, True),
        (ESTOP, 3600.0, True),
    ],
)
def test_only_what_is_young_enough_on_arrival_is_applied(
    topic: Topic[Any], age: float, applied: bool
) -> None:
    inbox = offered(topic, age)
    assert inbox.updated(topic) is applied
    assert (inbox.latest(topic) is not None) is applied
    if topic is not TELEOP_SETPOINT:
        assert len(inbox.events(topic)) == applied
    assert inbox.health_of(topic).stale == (not applied)
    assert inbox.stale == (not applied)
    link = next(link for link in inbox.link_health() if link.topic == topic.name)
    assert (link.stale, link.received, link.refused) == (not applied, 1, 0)


@pytest.mark.parametrize("ahead", [-0.2, 0.2])
def test_the_senders_clock_is_taken_into_account(ahead: float) -> None:
    context = InboxContext(offset_of=lambda _header: round(-ahead * SECOND))
    for age, applied in ((0.24, True), (0.26, False)):
        inbox = offered(TELEOP_SETPOINT, age, clock_ahead=ahead, context=context)
        assert inbox.updated(TELEOP_SETPOINT) is applied


@pytest.mark.parametrize(
    ("topic", "heard_for", "applied"),
    [
        (TELEOP_GAIT, 0.0, True),
        (TELEOP_GAIT, 1.9, True),
        (TELEOP_GAIT, 2.1, False),
        (TELEOP_SETPOINT, 2.1, False),
        (ESTOP, 100.0, True),
    ],
)
def test_messages_of_unknown_age_are_taken_for_a_grace_time_only(
    topic: Topic[Any], heard_for: float, applied: bool
) -> None:
    """The sender's clock is 1000 s behind, and it answers no clock query."""
    inbox = Inbox(TOPICS, context=InboxContext(offset_of=lambda _header: UNKNOWN))
    for number, at in enumerate((NOW, NOW + round(heard_for * SECOND))):
        header = Header(seq=number, sent=at - 1000 * SECOND, source="far", boot=1)
        inbox.offer("teleop/setpoint", encode(setpoint(), header), at)
        inbox.begin_step(at)
    inbox.offer(topic.name, encode(EXAMPLES[topic.name], header), at)
    inbox.begin_step(at)
    assert inbox.updated(topic) is (applied and topic is not TELEOP_SETPOINT)
    health = inbox.health_of(topic)
    assert (health.stale > 0) is not applied
    assert ("far does not tell its clock" in health.last_refusal) is not applied


@pytest.mark.parametrize(("age", "applied"), [(0.01, True), (0.26, False), (-0.01, False)])
def test_a_tool_of_this_host_needs_no_answer(age: float, applied: bool) -> None:
    """It never answers, but by this host's clock its messages are young."""
    inbox = Inbox(TOPICS, context=InboxContext(offset_of=lambda _header: UNKNOWN))
    for number, at in enumerate((NOW, NOW + 60 * SECOND)):
        header = Header(seq=number, sent=at - round(age * SECOND), source="up", boot=1)
        inbox.offer("teleop/setpoint", encode(setpoint(), header), at)
        inbox.begin_step(at)
    assert inbox.updated(TELEOP_SETPOINT) is applied


def test_a_message_that_does_not_say_when_it_was_sent_is_of_unknown_age() -> None:
    inbox = Inbox(TOPICS)
    for number, at in enumerate((NOW, NOW + 3 * SECOND)):
        inbox.offer(
            "teleop/setpoint", encode(setpoint(), Header(seq=number, boot=1, source="by hand")), at
        )
        inbox.begin_step(at)
        assert inbox.updated(TELEOP_SETPOINT) is (number == 0)


def test_delay_injected_on_purpose_makes_nothing_old() -> None:
    links = Links.from_table({"teleop/setpoint": "500ms", "teleop/gait": "900ms"}, ["wbc"])
    for topic in (TELEOP_SETPOINT, TELEOP_GAIT):
        assert offered(topic, 0.2, links=links).updated(topic)
        assert not offered(topic, 0.6, links=links).updated(topic)


def test_what_is_old_is_no_gap_and_the_next_is_applied() -> None:
    inbox = offered(TELEOP_GAIT, 1.0, seq=4)
    for seq in (5, 6):
        header = Header(seq=seq, sent=NOW, source="teleop", boot=1)
        inbox.offer("teleop/gait", encode(EXAMPLES["teleop/gait"], header), NOW + 1000)
    inbox.begin_step(NOW + SECOND)
    assert len(inbox.events(TELEOP_GAIT)) == 2
    status = inbox.health_of(TELEOP_GAIT)
    assert (status.gaps, status.stale, status.late) == (0, 1, 0)


def test_a_slow_network_may_have_its_own_limits(tmp_path: Any) -> None:
    ages = settings(tmp_path, '[runtime]\nmax_age = {"teleop/setpoint" = 0.6}\n')
    assert ages == {"teleop/setpoint": 0.6}
    assert offered(TELEOP_SETPOINT, 0.59, max_age=ages).updated(TELEOP_SETPOINT)
    assert not offered(TELEOP_SETPOINT, 0.61, max_age=ages).updated(TELEOP_SETPOINT)
    # It rules how long the last one is fresh, too.
    inbox = offered(TELEOP_SETPOINT, 0.1, max_age=ages)
    for after, fresh in ((0.59, True), (0.61, False)):
        inbox.begin_step(NOW + round(after * SECOND))
        assert inbox.fresh(TELEOP_SETPOINT) is fresh
    # The others keep theirs.
    assert not offered(TELEOP_GAIT, 0.51, max_age=ages).updated(TELEOP_GAIT)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ('[runtime]\nmax_age = {"teleop/set" = 0.6}\n', "no topic 'teleop/set'"),
        ('[runtime]\nmax_age = {"teleop/setpoint" = 0}\n', "greater than 0"),
    ],
)
def test_a_wrong_limit_is_explained(tmp_path: Any, text: str, complaint: str) -> None:
    with pytest.raises(ConfigError, match=complaint):
        settings(tmp_path, text)


def settings(tmp_path: Any, text: str) -> Mapping[str, float]:
    path = tmp_path / "stack.toml"
    path.write_text(text)
    arguments = argument_parser("wbc").parse_args(["--config", str(path)])
    runtime = load_settings(arguments, "wbc", {})[2]
    return runtime.max_age


class Cut:
    """A publisher and a reader with a proxy between them that stalls."""

    def __init__(self) -> None:
        port = free_base_port(1)
        # A lease longer than the cut: the link stays, and all that was held up arrives.
        common: dict[str, Any] = {"lease_ms": 20_000}
        self.sender: Any = open_session(
            BusConfig(listen=(f"tcp/127.0.0.1:{port}",), connect=(), **common), "sim"
        )
        self.proxy = StallingProxy(port)
        endpoint = f"tcp/127.0.0.1:{self.proxy.port}"
        config = BusConfig(listen=(), connect=(endpoint,), **common)
        self.reader: Any = open_session(config, "wbc")
        self.inbox = Inbox(TOPICS)
        self.subscribers = subscribe(self.reader, "draco3", self.inbox, TOPICS)
        self.publishers: dict[str, Publisher[Any]] = {
            topic.name: Publisher(self.sender, "draco3", topic, "sim", 1) for topic in TOPICS
        }
        self.ages: dict[str, list[float]] = {topic.name: [] for topic in TOPICS}
        self.beats = self.now = 0

    def close(self) -> None:
        self.subscribers.clear()
        self.reader.close()
        self.sender.close()
        self.proxy.__exit__()

    def run(self, seconds: float) -> None:
        """Publish states and set-points at 100 Hz, gait requests at 10 Hz, and read it all."""
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.publishers["plant/state"].send(plant_state())
            self.publishers["teleop/setpoint"].send(EXAMPLES["teleop/setpoint"])
            if self.beats % 10 == 0:
                self.publishers["teleop/gait"].send(EXAMPLES["teleop/gait"])
            self.beats += 1
            time.sleep(0.01)
            self.read()

    def read(self) -> None:
        inbox, self.now = self.inbox, time.monotonic_ns()
        inbox.begin_step(self.now)
        for topic in (TELEOP_SETPOINT, PLANT_STATE):
            value = inbox.latest(topic)
            if value is not None and inbox.updated(topic):
                self.note(topic, value)
        for event_topic in (TELEOP_GAIT, ESTOP):
            for event in inbox.events(event_topic):
                self.note(event_topic, event)

    def note(self, topic: Topic[Any], message: Message) -> None:
        received_ns = self.now - round(1e9 * self.inbox.age(topic))
        self.ages[topic.name].append(1e-9 * (received_ns - message.header.sent))


@pytest.fixture
def cut() -> Iterator[Cut]:
    made = Cut()
    yield made
    made.close()


def test_after_a_cut_of_two_seconds_only_what_is_young_is_applied(cut: Cut) -> None:
    give_up = time.monotonic() + 20.0
    while not cut.ages["teleop/gait"] and time.monotonic() < give_up:
        cut.run(0.1)
    assert cut.ages["teleop/gait"]
    cut.run(1.0)
    before = {topic.name: cut.inbox.health_of(topic).stale for topic in TOPICS}
    cut.proxy.stall()
    cut.run(0.3)
    cut.publishers["estop"].send(EXAMPLES["estop"])
    cut.run(1.7)
    applied = {name: len(ages) for name, ages in cut.ages.items()}
    cut.proxy.resume()
    cut.run(2.0)
    for topic in TOPICS:
        assert max(cut.ages[topic.name], default=0.0) <= topic.max_age
    # It did arrive, and was not applied; the emergency stop was, though it was 1.7 s old.
    stale = {topic.name: cut.inbox.health_of(topic).stale - before[topic.name] for topic in TOPICS}
    # Of latest values that come in one heap only the newest are looked at, the others let go.
    assert stale["plant/state"] + cut.inbox.health_of(PLANT_STATE).skipped > 50
    assert stale["plant/state"] > 0
    assert stale["teleop/setpoint"] > 0
    assert stale["teleop/gait"] >= 5
    assert stale["estop"] == 0
    (age,) = cut.ages["estop"]
    assert age > 1.0
    # And it goes on.
    for name in ("plant/state", "teleop/setpoint", "teleop/gait"):
        assert len(cut.ages[name]) > applied[name] + 10


def test_what_was_let_go_before_a_stale_message_is_not_missing() -> None:
    inbox = Inbox([PLANT_STATE], service="wbc")
    state = plant_state()
    sent = [NOW + number * SECOND // 100 for number in range(100)]
    for number, time_ns in enumerate(sent):
        header = Header(seq=number, sent=time_ns, boot=1, source="sim")
        # The first comes in time; then the reader stands still and gets all the rest at once.
        inbox.offer(PLANT_STATE.name, encode(state, header), sent[0 if number == 0 else -1])
        if number == 0:
            inbox.begin_step(time_ns)
    inbox.begin_step(sent[-1])
    status = inbox.health_of(PLANT_STATE)
    assert status.skipped > 50
    assert status.stale > 10
    assert status.gaps == 0
