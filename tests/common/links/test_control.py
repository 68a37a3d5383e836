"""Live changes of links: what wins, what is refused, what a newcomer takes over."""

import msgpack
import pytest

from common.links.config import Links
from common.links.control import (
    MAX_BYTES,
    LinkControlError,
    LinkEntry,
    LinkReply,
    LinkRequest,
    LinkTable,
    from_wire,
    links_key,
    to_wire,
)
from common.links.spec import Distribution, LinkSpec

CONFIGURED = Links.from_table({"wbc:teleop/setpoint": "10ms"})


def table(service: str = "wbc") -> LinkTable:
    return LinkTable(service, CONFIGURED)


def ask(action: str = "set", version: int | None = None, **links: str | None) -> LinkRequest:
    return LinkRequest.model_validate({"action": action, "links": links, "version": version})


def mean(of: LinkTable, topic: str) -> float | None:
    spec = of.of(topic)
    return None if spec is None else spec.mean


def test_live_wins_over_configured_and_clearing_over_both() -> None:
    links = table()
    assert mean(links, "teleop/setpoint") == 0.01
    links.apply(ask(command="250ms"), 5)
    assert (mean(links, "teleop/setpoint"), mean(links, "teleop/gait")) == (0.25, 0.25)
    assert links.of("plant/state") is None
    links.apply(ask(command=None), 6)
    assert links.of("teleop/setpoint") is None


def test_later_change_wins_and_the_more_specific_in_one() -> None:
    links = table()
    links.apply(LinkRequest(action="set", links={"wbc:teleop/gait": LinkSpec(mean=0.1)}), 1)
    links.apply(
        LinkRequest.model_validate(
            {"action": "set", "links": {"teleop/setpoint": "30ms", "command": "20ms"}}
        ),
        2,
    )
    assert (mean(links, "teleop/setpoint"), mean(links, "teleop/gait")) == (0.03, 0.02)


def test_versions_never_go_back() -> None:
    links = table()
    links.apply(ask(command="250ms"), 100)
    # The wall clock was set back.
    links.apply(ask(command="20ms"), 50)
    assert links.version == 101
    assert mean(links, "teleop/gait") == 0.02
    with pytest.raises(LinkControlError, match=r"version 101.*older than what is in force"):
        links.apply(ask(command="30ms", version=101), 0)
    assert mean(links, "teleop/gait") == 0.02


def test_clear_forgets_what_was_before_it() -> None:
    links = table()
    links.apply(ask(command="250ms"), 1)
    links.apply(ask("clear"), 2)
    assert links.of("teleop/setpoint") is None
    assert [entry.name for entry in links.entries] == ["*"]
    links.apply(ask(command="5ms"), 3)
    assert mean(links, "teleop/setpoint") == 0.005


def test_newcomer_takes_over_what_is_newer_in_whatever_order() -> None:
    first, other = table("teleop"), table("sim")
    first.apply(ask(command="250ms", version=10), 0)
    first.apply(ask(camera="100ms", version=20), 0)
    other.apply(ask(command="40ms", version=30), 0)
    for order in ((first, other), (other, first)):
        newcomer = table()
        for peer in order:
            newcomer.merge(peer.entries)
        assert mean(newcomer, "teleop/setpoint") == 0.04
        assert mean(newcomer, "camera/left") == 0.1
    # What was cleared meanwhile does not come back from one who missed it.
    other.apply(ask("clear", version=40), 0)
    newcomer.merge(other.entries)
    newcomer.merge(first.entries)
    assert newcomer.of("camera/left") is None


def test_a_peer_cannot_make_up_names() -> None:
    links = table()
    links.merge([LinkEntry(name="nowhere", spec=None, version=9)])
    assert links.entries == []
    links.merge([LinkEntry(name="odd:estop", spec=LinkSpec(mean=1.0), version=9)])
    assert links.of("estop") is None


@pytest.mark.parametrize(
    ("request_", "text"),
    [
        (ask(comand="5ms"), "no topic 'comand'"),
        (ask(), "at least one name"),
        (ask("clear", command="5ms"), "expected no links, got command"),
        (ask("list", command="5ms"), "expected no links"),
    ],
)
def test_impossible_requests_change_nothing(request_: LinkRequest, text: str) -> None:
    links = table()
    with pytest.raises(LinkControlError, match=text):
        links.apply(request_, 1)
    assert links.entries == []


def test_too_many_changes_are_refused() -> None:
    links = table()
    for number in range(256):
        links.apply(LinkRequest(action="set", links={f"s{number}:estop": None}), number)
    with pytest.raises(LinkControlError, match="more than 256"):
        links.apply(ask(command="1ms"), 1000)
    links.apply(ask("clear"), 1001)
    assert [entry.name for entry in links.entries] == ["*"]


def test_all_that_is_taken_can_be_told() -> None:
    links = table()
    for name in ("command", "camera", "estop", "plant/request"):
        trace = tuple(1e-3 * (number % 97 + 0.1) for number in range(15_000))
        spec = LinkSpec(distribution=Distribution.TRACE, trace=trace)
        request = from_wire(to_wire(LinkRequest(action="set", links={name: spec})), LinkRequest)
        links.apply(request, 1)
        links.apply(request, 2)  # takes the place of the same
    told = from_wire(to_wire(LinkReply(service="wbc", live=links.entries)), LinkReply)
    assert told.live == links.entries
    with pytest.raises(LinkControlError, match="75000 recorded delays"):
        links.apply(LinkRequest(action="set", links={"plant/status": spec}), 3)
    peers = [LinkEntry(name=f"s{number}:estop", spec=None, version=9) for number in range(300)]
    links.merge(peers)
    assert from_wire(to_wire(LinkReply(service="wbc", live=links.entries)), LinkReply)


def test_wire_form_round_trips() -> None:
    spec = LinkSpec.model_validate(
        {"distribution": "trace", "trace": [0.1, 0.2], "loss": 0.01, "keep_order": False}
    )
    request = LinkRequest(action="set", links={"camera": spec, "estop": None}, version=7)
    assert from_wire(to_wire(request), LinkRequest) == request
    reply = LinkReply(service="wbc", live=[LinkEntry(name="camera", spec=spec, version=7)])
    assert from_wire(to_wire(reply), LinkReply) == reply
    assert links_key("draco3", "wbc") == "draco3/links/wbc"


@pytest.mark.parametrize(
    ("payload", "text"),
    [
        (b"", "expected a msgpack map"),
        (b"\xc1", "expected a msgpack map"),
        (msgpack.packb([1]), "is wrong"),
        (msgpack.packb({"action": "destroy"}), "action"),
        (msgpack.packb({"action": "list", "more": 1}), "more: no such key"),
        (msgpack.packb({"action": "set", "links": {"camera": "soon"}}), "not a duration"),
        (msgpack.packb({"action": "set", "links": {"camera": {"mean": float("nan")}}}), "mean"),
        (msgpack.packb({"action": "set", "links": {"camera": " trace(/etc/passwd)"}}), "file"),
        (msgpack.packb({"action": "set", "links": {"camera": f"5ms seed={2**64}"}}), "seed"),
        (bytes(MAX_BYTES + 1), "expected at most 200000 bytes"),
    ],
)
def test_garbage_is_refused_in_words(payload: bytes, text: str) -> None:
    with pytest.raises(LinkControlError, match=text):
        from_wire(payload, LinkRequest)
