"""Live changes of links: what wins, what is refused, what is kept."""

from typing import Any

import msgpack
import pytest

from common.errors import ConfigError
from common.links.config import Links
from common.links.control import (
    MAX_BYTES,
    LinkControlError,
    LinkReply,
    LiveLinks,
    from_wire,
    to_wire,
)
from common.links.spec import Distribution, LinkSpec

CONFIGURED = Links.from_table({"wbc:teleop/setpoint": "10ms"})
NO_DELAY = LinkSpec()


def delay(seconds: float) -> LinkSpec:
    return LinkSpec(mean=seconds)


def trace(count: int) -> LinkSpec:
    delays = tuple(1e-3 * (number % 97 + 0.1) for number in range(count))
    return LinkSpec(distribution=Distribution.TRACE, trace=delays)


def mean(live: LiveLinks, topic: str, service: str = "wbc") -> float | None:
    spec = live.over(CONFIGURED).of(service, topic)
    return None if spec is None else spec.mean


def test_live_wins_over_configured_and_clearing_over_both() -> None:
    live = LiveLinks()
    assert mean(live, "teleop/setpoint") == 0.01
    live = live.with_links({"command": delay(0.25)}, 5)
    assert (mean(live, "teleop/setpoint"), mean(live, "teleop/gait")) == (0.25, 0.25)
    assert mean(live, "plant/state") is None
    live = live.with_links({"command": NO_DELAY}, 6)
    assert mean(live, "teleop/setpoint") == 0.0


def test_later_change_wins_and_the_more_specific_in_one() -> None:
    live = LiveLinks().with_links({"wbc:teleop/gait": delay(0.1)}, 1)
    live = live.with_links({"teleop/setpoint": delay(0.03), "command": delay(0.02)}, 2)
    assert (mean(live, "teleop/setpoint"), mean(live, "teleop/gait")) == (0.03, 0.02)
    # A name that is set again is the newest.
    live = live.with_links({"wbc:teleop/gait": delay(0.1)}, 3)
    assert mean(live, "teleop/gait") == 0.1
    assert [set(layer) for layer in live.layers] == [
        {"teleop/setpoint", "command"},
        {"wbc:teleop/gait"},
    ]


def test_versions_never_go_back() -> None:
    first = LiveLinks().with_links({"command": delay(0.25)}, 100)
    # The wall clock was set back.
    second = first.with_links({"command": delay(0.02)}, 50)
    assert (first.version, second.version, second.replaces) == (100, 101, 100)
    assert (second.without_links(7).version, second.without_links(700).version) == (102, 700)


def test_clear_forgets_what_was_before_it() -> None:
    live = LiveLinks().with_links({"command": delay(0.25)}, 1).without_links(2)
    assert (live.layers, mean(live, "teleop/setpoint"), mean(live, "teleop/gait")) == (
        (),
        None,
        None,
    )
    live = live.with_links({"teleop/gait": delay(0.005)}, 3)
    # What was configured stays off.
    assert (mean(live, "teleop/setpoint"), mean(live, "teleop/gait")) == (None, 0.005)


def test_setting_one_link_again_and_again_does_not_grow_the_document() -> None:
    live = LiveLinks()
    for number in range(1000):
        live = live.with_links({"command": delay(1e-3), "camera": delay(1e-3)}, number)
    assert len(live.layers) == 1


def test_unknown_names_are_refused_but_any_service_may_be_named() -> None:
    with pytest.raises(ConfigError, match="comand"):
        LiveLinks().with_links({"comand": delay(0.005)}, 1)
    live = LiveLinks().with_links({"odd:estop": delay(1.0)}, 1)
    assert (mean(live, "estop"), mean(live, "estop", "odd")) == (None, 1.0)


def test_too_many_changes_are_refused() -> None:
    full = LiveLinks().with_links({f"s{number}:estop": NO_DELAY for number in range(256)}, 1)
    with pytest.raises(LinkControlError, match="257 names"):
        full.with_links({"command": delay(0.001)}, 2)
    assert full.without_links(2).with_links({"command": delay(0.001)}, 3).layers


def test_the_longest_document_fits_into_a_reply() -> None:
    live = LiveLinks().with_links({f"s{number}:estop": NO_DELAY for number in range(252)}, 1)
    for name in ("command", "camera", "estop", "plant/request"):
        live = live.with_links({name: trace(15_000)}, 2)
        live = live.with_links({name: trace(15_000)}, 3)  # takes the place of the same
    assert from_wire(to_wire(LinkReply(service="wbc", live=live)), LinkReply).live == live
    with pytest.raises(LinkControlError, match="75000 recorded delays"):
        live.with_links({"s0:estop": trace(15_000)}, 4)


def test_wire_form_round_trips() -> None:
    spec = LinkSpec.model_validate(
        {"distribution": "trace", "trace": [0.1, 0.2], "loss": 0.01, "keep_order": False}
    )
    live = LiveLinks(cleared=True).with_links({"camera": spec, "estop": NO_DELAY}, 7)
    assert from_wire(to_wire(live), LiveLinks) == live
    reply = LinkReply(service="wbc", live=live)
    assert from_wire(to_wire(reply), LinkReply) == reply


def packed(**fields: Any) -> bytes:
    payload: bytes = msgpack.packb(fields)
    return payload


@pytest.mark.parametrize(
    ("payload", "text"),
    [
        (b"", "msgpack"),
        (b"\xc1", "msgpack"),
        (msgpack.packb([1]), "is wrong"),
        (packed(version=-1), "version"),
        (packed(more=1), "more: no such key"),
        (packed(layers=[{"comand": "5ms"}]), "comand"),
        (packed(layers=[{"camera": "soon"}]), "not a duration"),
        (packed(layers=[{"camera": {"mean": float("nan")}}]), "mean"),
        (packed(layers=[{"camera": " trace(/etc/passwd)"}]), "file"),
        (packed(layers=[{"camera": f"5ms seed={2**64}"}]), "seed"),
        (packed(layers=[{}] * 257), "layers"),
        (bytes(MAX_BYTES + 1), "1000000 bytes"),
    ],
)
def test_garbage_is_refused_in_words(payload: bytes, text: str) -> None:
    with pytest.raises(LinkControlError, match=text):
        from_wire(payload, LiveLinks)
