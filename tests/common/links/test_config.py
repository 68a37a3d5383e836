"""Aliases reach exactly the links they stand for, and the right entry wins."""

import itertools
from typing import Any, Literal

import pytest

from common.errors import ConfigError
from common.inbox.inbox import Inbox
from common.links.config import ALIASES, LinkName, Links, link_seed, parse_link_options
from common.ports import PORT_OFFSETS
from common.schemas import CameraFrame, Header
from common.topics import (
    ALL_TOPICS,
    CAMERA_LEFT,
    CAMERA_RIGHT,
    ESTOP,
    ESTOP_CLEAR,
    PLANT_REQUEST,
    WBC_COMMAND,
)
from common.wire.codec import encode

OPERATOR_READS = {
    *("plant/state", "plant/truth", "plant/status", "task/scene", "task/status"),
    *("wbc/state", "wbc/reply", "wbc/authority", "wbc/target"),
}
EYES = {"camera/left", "camera/right"}


def reached(alias: str, service: str) -> set[str]:
    name = LinkName.parse(alias)
    return {topic.name for topic in ALL_TOPICS if name.covers(service, topic.name)}


def test_command_is_what_the_controller_hears_of_the_operator() -> None:
    assert reached("command", "wbc") == {"teleop/setpoint", "teleop/gait"}
    assert all(not reached("command", service) for service in PORT_OFFSETS if service != "wbc")


def test_camera_is_both_eyes_for_everyone() -> None:
    assert all(reached("camera", service) == EYES for service in PORT_OFFSETS)


@pytest.mark.parametrize("service", ["teleop", "keyboard"])
def test_feedback_is_what_operators_see(service: str) -> None:
    assert reached("feedback", service) == EYES | OPERATOR_READS


@pytest.mark.parametrize("service", ["wbc", "sim", "cameras", "logger"])
def test_feedback_leaves_the_robots_own_loop_alone(service: str) -> None:
    assert reached("feedback", service) == EYES


def test_both_is_command_and_feedback() -> None:
    for service in PORT_OFFSETS:
        assert reached("both", service) == reached("command", service) | reached(
            "feedback", service
        )


def test_every_operators_inputs_are_reached_but_for_the_operators_own() -> None:
    keyboard = pytest.importorskip("services.teleop.keyboard.service").KeyboardOperator
    scripted = pytest.importorskip("services.teleop.scripted.service").ScriptedOperator
    for service in (keyboard, scripted):
        left = {topic.name for topic in service.reads} - reached("feedback", service.name)
        assert left <= {"teleop/status"}


@pytest.mark.parametrize("topic", [ESTOP, ESTOP_CLEAR, PLANT_REQUEST, WBC_COMMAND])
def test_safety_is_delayed_under_its_own_name_only(topic: object) -> None:
    name = getattr(topic, "name", "")
    everything = Links.from_table(dict.fromkeys(ALIASES, "1s"))
    assert all(everything.of(service, name) is None for service in PORT_OFFSETS)
    assert Links.from_table({name: "1s"}).of("sim", name) is not None


def of(links: Links, service: str, topic: str) -> float | None:
    spec = links.of(service, topic)
    return None if spec is None else spec.mean


# From the most to the least specific.
NAMES = {
    "teleop:camera/left": "1ms",
    "camera/left": "2ms",
    "teleop:camera": "3ms",
    "teleop:feedback": "4ms",
    "camera": "5ms",
    "feedback": "6ms",
    "both": "7ms",
}


@pytest.mark.parametrize(("first", "second"), list(itertools.combinations(NAMES, 2)))
def test_more_specific_wins_in_one_source(first: str, second: str) -> None:
    for order in ((first, second), (second, first)):
        links = Links.from_table({name: NAMES[name] for name in order})
        assert of(links, "teleop", "camera/left") == pytest.approx(0.001 * float(NAMES[first][0]))


def test_later_source_wins_whatever_its_name() -> None:
    file = Links.from_table({"wbc:teleop/setpoint": "10ms", "camera": "20ms"})
    links = file.under(Links.from_table({"command": "250ms"}))
    assert of(links, "wbc", "teleop/setpoint") == 0.25
    assert of(links, "wbc", "teleop/gait") == 0.25
    assert of(links, "teleop", "camera/left") == 0.02
    assert of(file.under(Links()), "wbc", "teleop/setpoint") == 0.01


def test_variable_may_hold_two_sources() -> None:
    both = Links.from_variable("wbc:teleop/setpoint=1ms; camera=2ms ;; command=3ms loss=1%")
    assert of(both, "wbc", "teleop/setpoint") == 0.003
    assert of(both, "teleop", "camera/right") == 0.002
    assert Links.from_variable(" ; ") == Links()


def test_both_eyes_have_one_seed_and_nothing_else_shares_it() -> None:
    assert link_seed(3, "teleop", "camera/left") == link_seed(3, "teleop", "camera/right")
    seeds = {link_seed(3, service, "camera/left") for service in ("teleop", "policy")}
    assert len({*seeds, link_seed(3, "teleop", "plant/state")}) == 3


def camera_frame(eye: Literal["left", "right"], number: int) -> bytes:
    frame = CameraFrame(eye=eye, width=1, height=1, encoding="rgb8", data=bytes(3))
    # The eyes' own counters differ, as one was wanted before the other.
    seq = number + (40 if eye == "left" else 0)
    header = Header(seq=seq, stamp=1 + number * 50_000_000, sent=number * 5_000_000)
    return encode(frame, header)


def test_stereo_pair_comes_out_of_a_jittered_link_together() -> None:
    links = Links.from_table({"camera": "lognormal(122ms, 90ms) corr=300ms order=free loss=10%"})
    inbox = Inbox((CAMERA_LEFT, CAMERA_RIGHT), service="teleop", links=links)
    injected: dict[str, dict[int, int]] = {"left": {}, "right": {}}
    for step in range(4000):
        now = step * 5_000_000
        if step % 10 == 0 and step < 3000:
            for name, side in (("camera/left", "left"), ("camera/right", "right")):
                if side == "right" and step % 70 == 0:
                    continue  # dropped on its way: the others must not shift
                inbox.offer(name, camera_frame("left" if side == "left" else "right", step), now)
        inbox.begin_step(now)
        for topic, side in ((CAMERA_LEFT, "left"), (CAMERA_RIGHT, "right")):
            frame = inbox.latest(topic)
            if frame is not None and inbox.updated(topic):
                injected[side][frame.header.stamp] = frame.header.injected
    both = injected["left"].keys() & injected["right"].keys()
    assert {stamp: injected["left"][stamp] for stamp in both} == {
        stamp: injected["right"][stamp] for stamp in both
    }
    dropped = {1 + step * 50_000_000 for step in range(0, 3000, 70)}
    # Free order: of two that come out in one step the later is shown, maybe of one eye only.
    assert len(injected["left"].keys() - both - dropped) < 10
    assert 150 < len(both) < 260
    assert len(set(injected["left"].values())) > 100


def test_links_for_all_consumers_and_for_one() -> None:
    links = Links.from_table({"plant/state": "5ms", "wbc:plant/state": "20ms"})
    assert (of(links, "wbc", "plant/state"), of(links, "logger", "plant/state")) == (0.02, 0.005)
    assert links.of("wbc", "estop") is None


def test_services_outside_the_port_table_have_to_be_announced() -> None:
    with pytest.raises(ConfigError, match="no service 'second'"):
        Links.from_table({"second:estop": "5ms"})
    assert Links.from_table({"second:estop": "5ms"}, also=["second"]).of("second", "estop")


@pytest.mark.parametrize(
    ("table", "text"),
    [
        ({"plant/stat": "5ms"}, "no topic 'plant/stat'.*plant/state"),
        ({"comand": "5ms"}, "'comand'.*command, camera, feedback, both.*teleop/setpoint"),
        ({"wbc:nothing": "5ms"}, "no topic 'nothing'"),
        ({"": "5ms"}, "no topic ''"),
        ({"sim:": "5ms"}, "no topic ''"),
        ({"estop": 5}, "'estop' is wrong"),
        ({"estop": {"mean": -1}}, "'estop' is wrong"),
        ({"estop": "soon"}, "'estop' is wrong: 'soon' is not a duration"),
        ({"wcb:estop": "5ms"}, "'wcb:estop': no service 'wcb'.*teleop, wbc"),
        ({":estop": "5ms"}, "':estop'"),
    ],
)
def test_wrong_links_are_refused(table: dict[str, Any], text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        Links.from_table(table)


def test_link_option_needs_an_equals_sign() -> None:
    with pytest.raises(ConfigError, match="topic=spec"):
        parse_link_options(["plant/state 5ms"])


def test_links_of_one_run_do_not_jitter_alike() -> None:
    seeds = {link_seed(s, c, t) for s in (0, 1) for c in ("a", "b") for t in ("x", "y")}
    assert len(seeds) == 8
