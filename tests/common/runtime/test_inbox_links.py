"""Live links on an inbox: the newest document is in force, and every change is reported."""

from common.inbox.inbox import Inbox
from common.links.config import Links
from common.links.control import LiveLinks
from common.links.spec import LinkSpec
from common.runtime.inbox_links import InboxLinks
from common.schemas import LinkChange
from common.topics import PLANT_STATE, TELEOP_GAIT

CONFIGURED = Links.from_table({"plant/state": "5ms"})


def started() -> tuple[InboxLinks, Inbox]:
    inbox = Inbox((PLANT_STATE, TELEOP_GAIT), service="wbc", links=CONFIGURED)
    return InboxLinks("wbc", CONFIGURED, inbox), inbox


def delays(inbox: Inbox) -> list[str]:
    return [inbox.link_of(topic) for topic in inbox.topics]


def words(changes: list[LinkChange]) -> list[tuple[str, str, str, str]]:
    return [(c.topic, c.previous, c.link, c.reason) for c in changes]


def test_every_change_of_an_input_is_reported_once() -> None:
    links, inbox = started()
    assert words(links.initial()) == [("plant/state", "", "5ms", "start")]
    live = LiveLinks().with_links({"both": LinkSpec(mean=0.03)}, 1)
    assert words(links.apply(live, "request")) == [("teleop/gait", "", "30ms", "request")]
    assert links.apply(live, "peer") == []
    off = live.without_links(2)
    assert words(links.apply(off, "peer")) == [
        ("plant/state", "5ms", "", "peer"),
        ("teleop/gait", "30ms", "", "peer"),
    ]
    assert delays(inbox) == ["", ""]


def test_the_newest_is_in_force_in_whatever_order_peers_answer() -> None:
    old = LiveLinks().with_links({"command": LinkSpec(mean=0.25)}, 10)
    new = old.with_links({"plant/state": LinkSpec(mean=0.1)}, 20).with_links(
        {"command": LinkSpec(mean=0.04)}, 30
    )
    for order in ((old, new), (new, old)):
        links, inbox = started()
        for live in order:
            links.apply(live, "peer")
        assert delays(inbox) == ["100ms", "40ms"]
        assert links.live == new
    # What was cleared meanwhile does not come back from a peer that missed it.
    links.apply(new.without_links(40), "peer")
    links.apply(new, "peer")
    assert delays(inbox) == ["", ""]


def test_rows_hold_what_each_link_did() -> None:
    links, inbox = started()
    inbox.offer("plant/state", b"", 0)
    inbox.begin_step(5_000_000)
    state, gait = links.rows()
    assert (state.topic, state.link, gait.link, gait.delays) == ("plant/state", "5ms", "", None)
    assert state.delays is not None
    assert (state.delays.pushed, state.delays.achieved_mean) == (1, 0.005)
