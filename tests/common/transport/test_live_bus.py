"""Publishers, inboxes and taps over real sessions on loopback."""

import itertools
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any

import msgpack
import pytest

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.schemas import Estop, GuardMode, Header, PlantState
from common.topics import ESTOP, HEALTH, PLANT_STATE, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import BusError, new_boot_id, open_session
from common.transport.tap import RawTap
from common.wire.codec import encode, schema_tag
from common.wire.schema import describe
from tests.common.transport.support import free_base_port, health, plant_state

PATIENCE_S = 15.0
ESTOP_TEXT = "stop"


def until(condition: Callable[[], bool]) -> bool:
    """Poll until true; False after a long time."""
    give_up = time.monotonic() + PATIENCE_S
    while not condition():
        if time.monotonic() > give_up:
            return False
        time.sleep(0.01)
    return True


class Bus:
    """Sessions, readers and publishers of one test."""

    def __init__(self, stack: ExitStack) -> None:
        self.config = BusConfig(base_port=free_base_port())
        self._stack = stack

    def session(self, name: str, config: BusConfig | None = None) -> Any:
        session: Any = open_session(config or self.config, name)
        self._stack.callback(session.close)
        return session

    def reader(self, session: Any, *topics: Topic[Any], robot: str = "draco3") -> Inbox:
        inbox = Inbox(topics)
        subscribers = subscribe(session, robot, inbox, topics)
        self._stack.callback(subscribers.clear)
        return inbox


@pytest.fixture
def bus() -> Iterator[Bus]:
    with ExitStack() as stack:
        yield Bus(stack)


def arrived(inbox: Inbox, topic: Topic[Any], send: Callable[[], object]) -> bool:
    """Send until something good arrives."""

    def attempt() -> bool:
        send()
        inbox.begin_step(time.monotonic_ns())
        return inbox.updated(topic)

    return until(attempt)


def test_typed_message_crosses_the_bus(bus: Bus) -> None:
    inbox = bus.reader(bus.session("wbc"), PLANT_STATE)
    boot = new_boot_id()
    publisher = Publisher(bus.session("sim"), "draco3", PLANT_STATE, "sim", boot)
    message = plant_state().model_copy(update={"header": Header(stamp=42, seq=9, source="x")})
    assert arrived(inbox, PLANT_STATE, lambda: publisher.send(message))
    got = inbox.latest(PLANT_STATE)
    assert got is not None
    header = got.header
    assert (header.stamp, header.source, header.boot) == (42, "sim", boot)
    assert 0 <= header.seq < publisher.sent
    assert got.joint_torque.tobytes() == message.joint_torque.tobytes()
    assert inbox.health_of(PLANT_STATE).refused == 0
    assert publisher.errors == 0


def test_every_event_arrives_once_in_order(bus: Bus) -> None:
    inbox = bus.reader(bus.session("wbc"), ESTOP)
    publisher = Publisher(bus.session("sim"), "draco3", ESTOP, "sim", 1)
    assert arrived(inbox, ESTOP, lambda: publisher.send(Estop(reason="hello")))
    start = publisher.sent
    numbers: list[int] = []

    def collect() -> bool:
        inbox.begin_step(time.monotonic_ns())
        numbers.extend(event.header.seq for event in inbox.events(ESTOP))
        return bool(numbers) and numbers[-1] == start + 99

    for _ in range(100):
        assert publisher.send(Estop(reason="again"))
        # Faster than people, but not a burst: an event waits for room in the queue only briefly.
        time.sleep(0.002)
    assert until(collect)
    assert numbers[-100:] == list(range(start, start + 100))
    assert inbox.health_of(ESTOP).gaps == 0


def test_per_source_topic_is_heard_from_everyone_but_oneself(bus: Bus) -> None:
    sessions = {name: bus.session(name) for name in ("sim", "wbc", "monitor")}
    inbox = bus.reader(sessions["monitor"], HEALTH)
    publishers = [
        Publisher(session, "draco3", HEALTH, name, 1) for name, session in sessions.items()
    ]

    def attempt() -> bool:
        for publisher in publishers:
            publisher.send(health())
        inbox.begin_step(time.monotonic_ns())
        return len(inbox.latest_by_sender(HEALTH)) == 2

    assert until(attempt)
    assert {s.source for s in inbox.latest_by_sender(HEALTH)} == {"sim", "wbc"}


def test_services_outside_the_table_find_each_other_through_one_inside(bus: Bus) -> None:
    inbox = bus.reader(bus.session("probe"), ESTOP)
    publisher = Publisher(bus.session("pendant"), "draco3", ESTOP, "pendant", 1)
    bus.session("sim")
    assert arrived(inbox, ESTOP, lambda: publisher.send(Estop(reason=ESTOP_TEXT)))


def test_another_robot_is_not_heard(bus: Bus) -> None:
    session = bus.session("wbc")
    inbox, other = bus.reader(session, ESTOP), bus.reader(session, ESTOP, robot="r2")
    publisher = Publisher(bus.session("sim"), "r2", ESTOP, "sim", 1)
    assert arrived(other, ESTOP, lambda: publisher.send(Estop(reason="stop")))
    inbox.begin_step(time.monotonic_ns())
    assert inbox.health_of(ESTOP).received == 0


def test_foreign_bytes_on_a_key_are_refused_and_explained(bus: Bus) -> None:
    inbox = bus.reader(bus.session("wbc"), PLANT_STATE)
    session = bus.session("sim")
    message = Estop(reason="not a state")

    def attempt() -> bool:
        session.put("draco3/plant/state", encode(message, message.header), encoding="text/plain")
        inbox.begin_step(time.monotonic_ns())
        return inbox.health_of(PLANT_STATE).refused > 0

    assert until(attempt)
    text = inbox.health_of(PLANT_STATE).last_refusal
    assert "received no schema" in text
    assert "unknown field 'reason'" in text
    assert inbox.latest(PLANT_STATE) is None


def test_senders_of_other_versions_are_heard_and_counted(bus: Bus) -> None:
    """An older one lacks the optional fields, a newer one has one more."""
    inbox = bus.reader(bus.session("wbc"), PLANT_STATE)
    session = bus.session("sim")
    own = schema_tag(PlantState)
    fields = msgpack.unpackb(encode(plant_state(), Header(boot=1)))
    assert fields["reset_count"] == 2
    optional = describe(PlantState).optional
    of_older = {name: value for name, value in fields.items() if name not in optional}

    number = itertools.count()

    def send(fields: dict[str, Any], tag: str) -> None:
        header = fields["header"] | {"seq": next(number)}
        payload = msgpack.packb(fields | {"header": header})
        session.put("draco3/plant/state", payload, encoding=f"application/msgpack;{tag}")

    def shown(count: int, fields: dict[str, Any], tag: str) -> bool:
        """Send until such a state is shown; earlier ones may still be under way."""

        def attempt() -> bool:
            send(fields, tag)
            inbox.begin_step(time.monotonic_ns())
            state = inbox.latest(PLANT_STATE)
            return state is not None and state.reset_count == count

        return until(attempt)

    assert shown(0, of_older, own.rpartition(";")[0])
    state = inbox.latest(PLANT_STATE)
    assert state is not None
    assert state.guard is GuardMode.ACTIVE
    assert shown(3, fields | {"reset_count": 3, "battery": 0.5}, f"{own}12ab")
    (link,) = inbox.link_health()
    assert 2 <= link.adapted <= link.received
    assert link.refused == 0
    # Once one of this version has come, those of the others are through.
    assert shown(4, fields | {"reset_count": 4}, own)
    counted = inbox.link_health()[0].adapted
    assert shown(5, fields | {"reset_count": 5}, own)
    assert inbox.link_health()[0].adapted == counted


def test_tap_sees_everything_of_its_robot_with_tags(bus: Bus) -> None:
    tap = RawTap(bus.session("logger"), "draco3")
    session = bus.session("sim")
    publishers: list[Publisher[Any]] = [
        Publisher(session, "draco3", HEALTH, "sim", 1),
        Publisher(session, "draco3", ESTOP, "sim", 1),
    ]
    foreign = Publisher(session, "r2", ESTOP, "sim", 1)
    seen: dict[str, tuple[bytes, str, int]] = {}

    def attempt() -> bool:
        foreign.send(Estop(reason="elsewhere"))
        publishers[0].send(health())
        publishers[1].send(Estop(reason="here"))
        session.put("draco3/extra", b"raw")
        for key, payload, tag, arrival_ns in tap.drain():
            seen[key] = (payload, tag, arrival_ns)
        return len(seen) == 3

    assert until(attempt)
    assert set(seen) == {"draco3/health/sim", "draco3/estop", "draco3/extra"}
    assert seen["draco3/estop"][1] == schema_tag(Estop)
    assert seen["draco3/extra"][:2] == (b"raw", "")
    assert 0 < seen["draco3/estop"][2] <= time.monotonic_ns()


def test_tap_that_is_not_drained_lets_the_oldest_go(bus: Bus) -> None:
    tap = RawTap(bus.session("logger"), "draco3", maxlen=10)
    session = bus.session("sim")
    sent = 0

    def attempt() -> bool:
        nonlocal sent
        session.put("draco3/extra", str(sent).encode())
        sent += 1
        return tap.received >= 50

    assert until(attempt)
    tap.close()
    kept = [int(sample.payload) for sample in tap.drain()]
    assert len(kept) == 10
    assert kept[-1] >= tap.received - 1
    assert kept == list(range(kept[0], kept[0] + 10))
    assert tap.drain() == []


def test_sending_on_a_closed_session_only_counts(bus: Bus) -> None:
    session: Any = open_session(bus.config, "sim")
    publisher = Publisher(session, "draco3", ESTOP, "sim", 1)
    session.close()
    assert not publisher.send(Estop(reason="stop"))
    assert (publisher.sent, publisher.errors) == (0, 1)


def test_taken_port_is_an_error_that_says_how_to_mend_it(bus: Bus) -> None:
    bus.session("sim")
    with pytest.raises(BusError, match=r"sim cannot open the bus.*choose another base port"):
        open_session(bus.config, "sim")


@pytest.mark.parametrize(
    ("wrong", "text"),
    [
        ({"listen": ("nonsense",)}, r"nonsense; expected an endpoint such as tcp/"),
        ({"listen": ("tcp/127.0.0.1:99999",)}, r"invalid port value; expected an endpoint"),
        ({"listen": ("foo/127.0.0.1:7000",)}, r"foo protocol; expected an endpoint"),
        ({"mode": "client", "connect": ("nonsense",)}, r"nonsense; expected an endpoint"),
        ({"listen": ("tcp/no such host:7000",)}, r"name cannot be resolved"),
        ({"zenoh": {"speed": 1}, "listen": ()}, r"unknown field `speed`"),
    ],
)
def test_only_a_taken_port_is_called_taken(wrong: dict[str, Any], text: str) -> None:
    with pytest.raises(BusError, match=text) as caught:
        open_session(BusConfig.model_validate({"connect": (), **wrong}), "sim")
    assert "another stack" not in str(caught.value)


def test_client_without_router_gives_up_and_says_so(bus: Bus) -> None:
    endpoint = f"tcp/127.0.0.1:{bus.config.base_port}"
    config = BusConfig(mode="client", connect=(endpoint,), patience_s=0.0)
    with pytest.raises(BusError, match=f"client of {endpoint}.*expected a router"):
        open_session(config, "wbc")


def test_clients_reach_each_other_through_a_router_and_its_successor(bus: Bus) -> None:
    endpoint = (f"tcp/127.0.0.1:{bus.config.base_port}",)
    router_config = BusConfig(mode="router", listen=endpoint, connect=())
    client_config = BusConfig(mode="client", connect=endpoint)
    router: Any = open_session(router_config, "router")
    inbox = bus.reader(bus.session("wbc", client_config), ESTOP)
    publisher = Publisher(bus.session("sim", client_config), "draco3", ESTOP, "sim", 1)
    assert arrived(inbox, ESTOP, lambda: publisher.send(Estop(reason=ESTOP_TEXT)))
    router.close()
    received = inbox.health_of(ESTOP).received
    successor: Any = bus.session("router", router_config)
    assert arrived(inbox, ESTOP, lambda: publisher.send(Estop(reason=ESTOP_TEXT)))
    assert inbox.health_of(ESTOP).received > received
    assert successor is not None


def test_late_router_is_waited_for(bus: Bus) -> None:
    endpoint = (f"tcp/127.0.0.1:{bus.config.base_port}",)
    asked = 0

    def stopping() -> bool:
        nonlocal asked
        asked += 1
        if asked == 1:
            bus.session("router", BusConfig(mode="router", listen=endpoint, connect=()))
        return False

    client = BusConfig(mode="client", connect=endpoint, patience_s=PATIENCE_S, retry_max_ms=50)
    session: Any = open_session(client, "wbc", stopping)
    session.close()
    assert asked >= 1
