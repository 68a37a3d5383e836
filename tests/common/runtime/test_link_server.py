"""Links of real processes are changed over the bus, published and kept over a restart."""

import time
from collections.abc import Callable, Iterator
from typing import Any, Self

import msgpack
import pytest
import zenoh

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.links.client import Answers, ask, read_links, set_links
from common.links.config import Links
from common.links.control import LinkControlError
from common.links.spec import LinkSpec
from common.queries import LINKS
from common.runtime.live.components import RunnerContext
from common.runtime.live.link_server import LinkServer
from common.schemas import LinkChange, Message
from common.topics import LINK_CHANGE, PLANT_STATE, WBC_COMMAND
from tests.common.runtime.test_live import Stack

WATCHED = (LINK_CHANGE, WBC_COMMAND)


class Watched(Stack):
    """The toy stack, and everything it tells of links."""

    def __init__(self) -> None:
        super().__init__()
        self.changes: list[LinkChange] = []
        self.watched = Inbox(WATCHED)
        self._more = subscribe(self.session, self.config.robot, self.watched, WATCHED)

    def heard(self, service: str, link: str, reason: str) -> bool:
        def there() -> bool:
            self.watched.begin_step(time.monotonic_ns())
            self.changes += self.watched.events(LINK_CHANGE)
            return any(
                (change.service, change.link, change.reason) == (service, link, reason)
                for change in self.changes
            )

        return self.until(there)

    def ages(self, count: int = 30) -> list[float]:
        """Age [s] of the states behind ``count`` commands made from now on."""
        now, ages = time.monotonic_ns(), list[float]()

        def collect() -> bool:
            self.watched.begin_step(time.monotonic_ns())
            self.changes += self.watched.events(LINK_CHANGE)
            command = self.watched.latest(WBC_COMMAND)
            if command is not None and self.watched.updated(WBC_COMMAND):
                sent = command.header.sent
                if sent > now:
                    ages.append(1e-9 * (sent - command.header.stamp))
            return len(ages) >= count

        assert self.until(collect)
        return ages

    def read(self) -> Answers:
        return read_links(self.session, self.config.robot)

    def set(self, name: str, text: str) -> dict[str, dict[str, str]]:
        """Set links; those of all inputs afterwards, by service and topic."""
        answers = set_links(self.session, self.config.robot, {name: LinkSpec.parse(text)})
        assert not answers.errors
        return {
            service: {row.topic: row.link for row in reply.inputs}
            for service, reply in answers.replies.items()
        }

    def stop(self) -> None:
        self._more.clear()
        super().stop()


@pytest.fixture
def stack() -> Iterator[Watched]:
    running = Watched()
    yield running
    running.stop()


def test_a_live_change_works_is_published_and_survives_a_restart(stack: Watched) -> None:
    stack.start("sim", "plant")
    wbc = stack.start("wbc", "controller", "--link", "plant/state=20ms")
    assert stack.until(stack.loop_closed)
    assert stack.heard("wbc", "20ms", "start")
    assert stack.set("plant/state", "150ms") == {
        "sim": {"wbc/command": ""},
        "wbc": {"plant/state": "150ms", "teleop/gait": ""},
    }
    assert stack.heard("wbc", "150ms", "request")
    # Until the first state comes through the new link, the last of the old one is used on.
    assert min(stack.ages(60)[30:]) >= 0.150
    row = next(row for row in stack.read().replies["wbc"].inputs if row.topic == PLANT_STATE.name)
    assert row.link == "150ms"
    assert row.delays is not None
    assert (row.delays.requested_mean, row.delays.lost) == (0.15, 0)
    assert row.delays.pushed > 20
    assert row.delays.achieved_mean == pytest.approx(0.15, abs=1e-9)
    wbc.kill()
    wbc.wait()
    stack.changes.clear()
    stack.start("wbc", "controller", "--link", "plant/state=20ms")
    assert stack.heard("wbc", "150ms", "peer")
    assert min(stack.ages(60)[30:]) >= 0.150
    # The other one's memory is enough the other way round, too.
    assert stack.set("plant/state", "0")["wbc"]["plant/state"] == ""
    assert stack.heard("wbc", "", "request")
    assert min(stack.ages(60)) < 0.100


def test_alias_is_known_and_wrong_or_outdated_changes_are_refused_by_all(stack: Watched) -> None:
    stack.start("wbc", "controller")
    before = stack.read().live
    assert stack.set("both", "30ms")["wbc"] == {"plant/state": "", "teleop/gait": "30ms"}
    key = LINKS.key(stack.config.robot, "*")
    unknown = msgpack.packb({"version": 2**62, "layers": [{"comand": "5ms"}]})
    for garbage, token in ((b"\xc1\x00", b"LiveLinks"), (unknown, b"comand")):
        (answer,) = list(stack.session.get(key, payload=garbage, target=zenoh.QueryTarget.ALL))
        assert answer.err is not None
        assert token in answer.err.payload.to_bytes()
    # Made without knowing of the change in between, which it would take back.
    late = before.with_links({"camera": LinkSpec(mean=0.1)}, time.time_ns())
    answers = ask(stack.session, stack.config.robot, late)
    assert answers.replies == {}
    assert "is in force" in answers.errors[0]
    assert [set(layer) for layer in stack.read().live.layers] == [{"both"}]


def test_reading_the_links_of_no_system_is_refused(stack: Watched) -> None:
    with pytest.raises(LinkControlError, match=r"'draco3'"):
        read_links(stack.session, stack.config.robot, patience_s=0.3)


class FakeSession:
    """A transport over which nothing comes by itself."""

    def declare_queryable(self, _key: str, receive: Callable[[Any], None], **_: Any) -> Self:
        self.receive = receive
        return self

    def get(self, *_: Any, **__: Any) -> None:
        return

    def undeclare(self) -> None:
        return


class Query:
    """A request, and what it is answered with."""

    def __init__(self, request: dict[str, Any]) -> None:
        self.payload = self
        self.answer: bytes | None = None
        self.error = ""
        self._bytes: bytes = msgpack.packb(request)

    def to_bytes(self) -> bytes:
        return self._bytes

    def reply(self, _key: str, payload: bytes) -> None:
        self.answer = payload

    def reply_err(self, text: str) -> None:
        self.error = text

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        return


@pytest.mark.parametrize("spec", [f"5ms seed={2**64}", "lognormal(1e-200s, 1s)"])
def test_no_request_ends_a_service_now_or_with_the_next_message(spec: str) -> None:
    inbox = Inbox((PLANT_STATE,), service="wbc")
    component, session = LinkServer("wbc", Links()), FakeSession()
    component.open(RunnerContext(session, "r", "wbc", 1, inbox, lambda *_: None, lambda _: False))
    for text, works in ((spec, False), ("lognormal(1ns, 1ms)", True)):
        query = Query({"version": 1, "layers": [{"plant/state": text}]})
        session.receive(query)
        component.poll(1)
        assert (query.answer is not None, query.error == "") == (works, works)
        inbox.offer("plant/state", b"", 1)
        inbox.begin_step(2)
    component.close()


def test_links_of_the_start_are_published_once_a_subscriber_exists() -> None:
    sent: list[Message] = []
    listening = False
    links = Links.from_table({"plant/state": "5ms"})
    inbox = Inbox((PLANT_STATE,), service="wbc", links=links)
    component = LinkServer("wbc", links)

    context = RunnerContext(
        FakeSession(), "r", "wbc", 1, inbox, lambda _, m: sent.append(m), lambda _: listening
    )
    component.open(context)
    now = time.monotonic_ns()
    for tenth in range(20):
        component.poll(now + tenth * 100_000_000)
    assert sent == []
    assert component.due_ns < now + 10 * 10**9
    listening = True
    for tenth in range(20, 200):
        component.poll(now + tenth * 100_000_000)
    published = [(m.topic, m.link, m.reason) for m in sent if isinstance(m, LinkChange)]
    # Again a little later, for a logger that comes after the first listener.
    assert published == [("plant/state", "5ms", "start")] * 3
    component.close()
