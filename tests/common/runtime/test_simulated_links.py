"""Links set at a virtual time are exact, recorded, and the same every time."""

import pytest

from common.errors import ConfigError, TrillError
from common.links.spec import Distribution, LinkSpec
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import LinkChange
from common.topics import LINK_CHANGE
from common.wire.codec import decode
from tests.common.runtime.toys import ToyController, ToyPlant

LINKS = {"plant/state": "20ms"}


def changes(runner: SimTimeRunner) -> list[tuple[float, LinkChange]]:
    return [
        (1e-9 * sample.arrival_ns, decode(sample.payload, LinkChange))
        for sample in runner.log
        if f"/{LINK_CHANGE.name}/" in sample.key
    ]


def words(runner: SimTimeRunner) -> list[tuple[float, str, str, str, str, str]]:
    return [(at, c.service, c.topic, c.previous, c.link, c.reason) for at, c in changes(runner)]


def test_link_changes_at_a_virtual_time_exactly() -> None:
    controller = ToyController()
    runner = SimTimeRunner([ToyPlant(), controller], links=LINKS, record=True)
    runner.run_for(0.5)
    (change,) = runner.set_link("plant/state", "45ms")
    assert (change.previous, change.link) == ("20ms", "45ms")
    runner.run_for(0.5)
    assert runner.set_link("plant/state", None, service="wbc")
    runner.run_for(0.5)
    injected = {injected for _, _, injected in controller.seen}
    assert injected == {20_000_000, 45_000_000, 0}
    for now, sent, delay in controller.seen:
        # Seen in the first step at or after the due time: a step every 10 ms, a state every 5.
        assert 0 <= now - sent - delay < 10_000_000 + 1
    sent_with = [(sent, delay) for _, sent, delay in controller.seen]
    assert all(delay == 20_000_000 for sent, delay in sent_with if sent < 500_000_000)
    assert words(runner) == [
        (0.0, "wbc", "plant/state", "", "20ms", "start"),
        (0.5, "wbc", "plant/state", "20ms", "45ms", "request"),
        (1.0, "wbc", "plant/state", "45ms", "", "request"),
    ]


def test_restarted_service_has_what_was_set() -> None:
    runner = SimTimeRunner([ToyPlant(), ToyController()], links=LINKS, record=True)
    runner.run_for(0.1)
    runner.set_link("wbc:plant/state", "60ms")
    runner.replace_service("wbc", fresh := ToyController())
    runner.run_for(0.5)
    assert {injected for _, _, injected in fresh.seen} == {60_000_000}
    assert words(runner)[-2:] == [
        (0.1, "wbc", "plant/state", "", "20ms", "start"),
        (0.1, "wbc", "plant/state", "20ms", "60ms", "peer"),
    ]


def test_same_calls_same_bytes() -> None:
    def digest(at: float) -> str:
        runner = SimTimeRunner([ToyPlant(), ToyController()], seed=3, record=True)
        runner.run_for(at)
        runner.set_link("plant/state", "lognormal(30ms, 30ms) loss=5%")
        runner.run_for(1.0 - at)
        return runner.digest()

    assert digest(0.3) == digest(0.3)
    assert digest(0.3) != digest(0.31)


def test_alias_reaches_its_links_only() -> None:
    runner = SimTimeRunner([ToyPlant(), ToyController()])
    (change,) = runner.set_link("both", "250ms")
    assert (change.service, change.topic) == ("wbc", "teleop/gait")


def test_wrong_calls_are_refused_and_change_nothing() -> None:
    runner = SimTimeRunner([ToyPlant(), ToyController()], record=True)
    with pytest.raises(TrillError, match=r"no input is called 'camera'.*sim, wbc"):
        runner.set_link("camera", "5ms")
    with pytest.raises(TrillError, match="no input is called 'sim:plant/state'"):
        runner.set_link("plant/state", "5ms", service="sim")
    with pytest.raises(ConfigError, match="no topic 'plant/stat'"):
        runner.set_link("plant/stat", "5ms")
    with pytest.raises(ConfigError, match="not a duration"):
        runner.set_link("plant/state", "soon")
    runner.run_for(0.1)
    assert changes(runner) == []


def test_another_trace_of_the_same_length_is_another_link() -> None:
    controller = ToyController()
    runner = SimTimeRunner([ToyPlant(), controller])
    for trace in ((0.02, 0.02), (0.05, 0.05)):
        spec = LinkSpec(distribution=Distribution.TRACE, trace=trace)
        assert len(runner.set_link("plant/state", spec)) == 1
        assert runner.set_link("plant/state", spec) == []
        controller.seen.clear()
        runner.run_for(0.5)
        assert controller.seen[-1][2] == round(1e9 * trace[0])
