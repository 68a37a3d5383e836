"""Links in front of an inbox: delayed, lost, and set while messages come."""

from typing import Any

import pytest

from common.inbox import arrivals
from common.inbox.inbox import Inbox
from common.links.config import Links
from common.links.spec import LinkSpec
from common.topics import PLANT_STATE
from tests.common.inbox.test_inbox import MS, TOPICS, gait, seq, state


def test_link_delays_arrival_exactly() -> None:
    inbox = Inbox(TOPICS, links=Links.from_table({"plant/state": "5ms"}))
    inbox.offer("plant/state", state(0), MS)
    inbox.begin_step(6 * MS - 1)
    assert inbox.latest(PLANT_STATE) is None
    assert inbox.health_of(PLANT_STATE).received == 0
    inbox.begin_step(8 * MS)
    value = inbox.latest(PLANT_STATE)
    assert value is not None
    assert value.header.injected == 5 * MS
    # Arrived when due, not when looked for.
    assert inbox.age(PLANT_STATE) == pytest.approx(0.002)
    assert inbox.delay_stats()["plant/state"].achieved_mean == pytest.approx(0.005)


def test_link_of_another_service_does_not_apply() -> None:
    inbox = Inbox(TOPICS, service="wbc", links=Links.from_table({"logger:plant/state": "5ms"}))
    inbox.offer("plant/state", state(0), 0)
    inbox.begin_step(0)
    assert seq(inbox) == 0
    assert inbox.delay_stats() == {}


def test_lost_on_the_link_is_a_gap() -> None:
    inbox = Inbox(TOPICS, seed=1, links=Links.from_table({"plant/state": "0 loss=50%"}))
    for number in range(200):
        inbox.offer("plant/state", state(number), number * MS)
        inbox.begin_step(number * MS)
    status = inbox.health_of(PLANT_STATE)
    lost = inbox.delay_stats()["plant/state"].lost
    assert 70 < lost < 130
    assert status.received == 200 - lost
    assert lost - 10 <= status.gaps <= lost


def test_delayed_trigger_arrives_when_due() -> None:
    inbox = Inbox(TOPICS, trigger=PLANT_STATE, links=Links.from_table({"plant/state": "5ms"}))
    inbox.offer("plant/state", state(0), MS)
    assert inbox.trigger_arrival(2 * MS) is None
    assert inbox.next_trigger_due_ns == 6 * MS
    assert inbox.trigger_arrival(7 * MS) == 6 * MS
    inbox.begin_step(7 * MS)
    assert seq(inbox) == 0


def test_next_release_is_the_arrival_until_the_link_knows_the_delay() -> None:
    inbox = Inbox(TOPICS, links=Links.from_table({"plant/state": "5ms"}))
    assert inbox.next_release_ns() is None
    inbox.offer("plant/state", state(0), MS)
    assert inbox.next_release_ns() == MS
    inbox.begin_step(2 * MS)
    assert inbox.next_release_ns() == 6 * MS
    inbox.offer("teleop/gait", gait(0), 3 * MS)
    assert inbox.next_release_ns() == 3 * MS
    inbox.begin_step(6 * MS)
    assert seq(inbox) == 0
    assert inbox.next_release_ns() is None


def test_a_payload_put_while_a_link_is_set_is_delayed(monkeypatch: pytest.MonkeyPatch) -> None:
    inbox = Inbox(TOPICS)
    inbox.offer("plant/state", state(0), MS)
    made = arrivals.RawMessage

    def raw_message(*values: Any) -> arrivals.RawMessage:
        """The service's thread sets a link while the transport's is at putting a payload."""
        monkeypatch.setattr(arrivals, "RawMessage", made)
        inbox.set_link("plant/state", LinkSpec.parse("5ms"))
        return made(*values)

    monkeypatch.setattr(arrivals, "RawMessage", raw_message)
    inbox.offer("plant/state", state(1), 2 * MS)
    inbox.begin_step(3 * MS)
    assert seq(inbox) == 0
    inbox.begin_step(7 * MS)
    assert seq(inbox) == 1
    value = inbox.latest(PLANT_STATE)
    assert value is not None
    assert value.header.injected == 5 * MS


def test_a_trigger_that_waits_when_a_link_is_set_still_arrives() -> None:
    inbox = Inbox(TOPICS, trigger=PLANT_STATE)
    inbox.offer("plant/state", state(0), MS)
    inbox.set_link("plant/state", LinkSpec.parse("5ms"))
    assert inbox.trigger_arrival(2 * MS) == MS
    assert inbox.trigger_arrival(3 * MS) is None
    inbox.offer("plant/state", state(1), 4 * MS)
    assert inbox.trigger_arrival(8 * MS) is None
    assert inbox.trigger_arrival(9 * MS) == 9 * MS
