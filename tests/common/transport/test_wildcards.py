"""One put on many keys: a stop of a whole fleet is obeyed and recorded, anything else refused."""

import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from typing import Any, NamedTuple

import pytest

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.schemas import Estop, Header, JointCommand, Message
from common.topics import ALL_TOPICS, ESTOP, PLANT_STATE, TELEOP_SETPOINT, WBC_COMMAND
from common.transport.config import BusConfig
from common.transport.keys import received_as
from common.transport.schema_query import SchemaServer, discover
from common.transport.session import open_session, wire_encoding
from common.transport.tap import RawSample, RawTap
from common.wire.codec import encode, schema_tag
from tests.common.transport.support import example_of, free_base_port

TOPICS = (ESTOP, WBC_COMMAND)


def until(condition: Callable[[], bool]) -> None:
    give_up = time.monotonic() + 20.0
    while not condition():
        assert time.monotonic() < give_up, "waited in vain"
        time.sleep(0.01)


class Fleet(NamedTuple):
    """A sender beside a plant and a recorder."""

    sender: Any
    plant: Inbox
    tap: RawTap

    def put(self, key: str, message: Message, seq: int = 0) -> None:
        payload = encode(message, Header(seq=seq, boot=1, source="fleet", sent=time.monotonic_ns()))
        self.sender.put(key, payload, encoding=wire_encoding(schema_tag(type(message))))

    def events(self, key: str, message: Message) -> list[Estop]:
        """Put until something has come on the topic, and return it."""
        received = self.plant.health_of(ESTOP).received
        found: list[Estop] = []

        def attempt() -> bool:
            self.put(key, message)
            self.plant.begin_step(time.monotonic_ns())
            found.extend(self.plant.events(ESTOP))
            return self.plant.health_of(ESTOP).received > received

        until(attempt)
        return found


@pytest.fixture
def fleet() -> Iterator[Fleet]:
    config = BusConfig(base_port=free_base_port())
    with ExitStack() as stack:

        def session(name: str) -> Any:
            opened: Any = open_session(config, name)
            stack.callback(opened.close)
            return opened

        inbox, plant = Inbox(TOPICS), session("sim")
        subscribers = subscribe(plant, "draco3", inbox, TOPICS)
        stack.callback(subscribers.clear)
        tap = RawTap(session("logger"), "draco3")
        stack.callback(tap.close)
        yield Fleet(session("keyboard"), inbox, tap)


@pytest.mark.parametrize("key", ["*/estop", "**/estop", "draco3/*", "draco3/est$*", "**"])
def test_a_fleets_stop_is_obeyed_and_recorded_under_the_robots_own_key(
    fleet: Fleet, key: str
) -> None:
    assert fleet.events(key, Estop(reason="fleet"))[0].reason == "fleet"
    samples: list[RawSample] = []

    def recorded() -> bool:
        fleet.put(key, Estop(reason="fleet"))
        samples.extend(fleet.tap.drain())
        return bool(samples)

    until(recorded)
    assert {(sample.key, sample.tag) for sample in samples} == {("draco3/estop", schema_tag(Estop))}


def test_a_command_for_everybody_is_refused_and_counted(fleet: Fleet) -> None:
    command = example_of(JointCommand)

    def refused() -> bool:
        fleet.put("*/wbc/command", command)
        fleet.plant.begin_step(time.monotonic_ns())
        return fleet.plant.health_of(WBC_COMMAND).refused > 0

    until(refused)
    until(lambda: fleet.tap.refused > 0)
    assert fleet.plant.latest(WBC_COMMAND) is None
    assert "wildcard" in fleet.plant.health_of(WBC_COMMAND).last_refusal
    assert fleet.tap.drain() == []


def test_keys_of_puts_on_many_keys() -> None:
    assert [topic for topic in ALL_TOPICS if topic.fleet] == [ESTOP]
    for key, own in {
        "r2/estop": "r2/estop",
        "r2/anything": "r2/anything",
        "*/estop": "draco3/estop",
        "draco3/**": "draco3/estop",
        "r2/*": None,
        "*/wbc/command": None,
    }.items():
        assert received_as("draco3", key) == own


def test_two_services_of_one_name_both_say_what_they_publish() -> None:
    config = BusConfig(base_port=free_base_port())
    with ExitStack() as stack:
        servers = []
        for name, topic in (("sim", PLANT_STATE), ("keyboard", TELEOP_SETPOINT)):
            session: Any = open_session(config, name)
            stack.callback(session.close)
            servers.append(SchemaServer(session, "draco3", "twin", (topic,)))
        asking: Any = open_session(config, "logger")
        stack.callback(asking.close)
        found: dict[str, Any] = {}

        def complete() -> bool:
            found.update(discover(asking, "draco3", timeout=0.3).get("draco3", {}))
            return bool(found)

        until(complete)
        # Both answer at once, so one query is enough once the peers know each other.
        until(lambda: len(discover(asking, "draco3", timeout=0.3).get("draco3", {})) == 2)
        for server in servers:
            server.close()
