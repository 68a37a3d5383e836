"""Statistics and live table of a bus with known traffic."""

import io
from typing import Any

import pytest
from rich.console import Console

from common.schemas import Header, Heartbeat, LinkHealth, OperatorStatus, PeerHealth, StageTime
from common.topics import HEALTH, HEARTBEAT, PLANT_STATE, PLANT_STATUS, TELEOP_STATUS
from common.transport.keys import key_of
from common.transport.tap import RawSample
from common.wire.codec import encode, schema_tag
from lab.monitor.bus_stats import HEALTH_TIMEOUT, WINDOW, BusStats, Snapshot
from lab.monitor.status_text import format_line
from lab.monitor.table import Content, render_table, share_lines
from tests.common.transport.support import health as example_health
from tests.lab.review.synthetic import FakeRobot, Pair

SECOND = 1_000_000_000


def sample(pair: Pair, at: float, robot: str = "draco3") -> RawSample:
    topic, message = pair
    key = key_of(robot, topic, message.header.source)
    tag = schema_tag(type(message))
    return RawSample(key, encode(message, message.header), tag, round(at * SECOND))


def test_rate_age_and_gaps() -> None:
    robot, stats = FakeRobot(), BusStats("draco3")
    for number in range(100):
        skip = 4 if number == 50 else 0
        pair = robot.plant(PLANT_STATE, 0, 0, 0, skip=skip)
        stats.add([sample(pair, at=number * 0.05)])
    (row,) = stats.snapshot(5 * SECOND).topics
    assert row.name == "plant/state"
    assert row.rate == pytest.approx(20.0, rel=0.05)
    assert row.age == pytest.approx(0.05)
    assert (row.messages, row.gaps, row.stale) == (100, 4, False)
    (row,) = stats.snapshot(9 * SECOND).topics
    assert row.rate == 0.0
    assert row.stale


def test_overtaken_repeated_and_missing_are_told_apart() -> None:
    robot, stats = FakeRobot(), BusStats("draco3")
    stream = [sample(robot.plant(PLANT_STATE, 0, 0, 0), at=0.01 * n) for n in range(10)]
    order = [0, 1, 1, 4, 3, 3, 7, 8, 1]
    stats.add([stream[n]._replace(arrival_ns=at) for at, n in enumerate(order)])
    (row,) = stats.snapshot(SECOND).topics
    # 2, 5 and 6 never came; 3 came after 4; 1 came two times too often, 3 one time.
    assert (row.gaps, row.late, row.repeated) == (3, 1, 3)
    assert row.has_problems


def test_a_heartbeat_tells_life_sooner_than_health() -> None:
    robot, stats = FakeRobot(), BusStats("draco3")
    stats.add([sample(robot.health("wbc", misses=0, median=0.0, p99=0.0), at=10.0)])
    (service,) = stats.snapshot(12 * SECOND).services
    assert (service.alive, service.heartbeat_age) == (True, None)
    stats.add([sample(beat(robot, "wbc", timeout=0.1), at=10.1)])
    (service,) = stats.snapshot(round(10.3 * SECOND)).services
    assert service.alive
    assert service.silence == pytest.approx(0.2)
    (service,) = stats.snapshot(round(10.5 * SECOND)).services
    assert not service.alive
    # Another service's heartbeat does not count; a longer timeout does.
    stats.add([sample(beat(robot, "sim", timeout=0.1), at=10.45)])
    assert not stats.snapshot(round(10.5 * SECOND)).services[0].alive
    stats.add([sample(beat(robot, "wbc", timeout=1.0), at=10.45)])
    assert stats.snapshot(round(12.5 * SECOND)).services[0].alive


def test_a_dead_services_inputs_and_peers_are_not_shown() -> None:
    stats = watched()
    assert stats.snapshot(SECOND).ledger
    assert stats.snapshot(SECOND).links
    assert stats.snapshot(SECOND).peers
    late = stats.snapshot(round((1 + HEALTH_TIMEOUT) * SECOND) + 1)
    assert (late.ledger, late.links, late.peers) == ((), (), ())


def test_services_and_what_their_readers_refuse() -> None:
    robot, stats = FakeRobot(), BusStats("draco3")
    for name in ("wbc", "sim"):
        pair = robot.health(name, misses=3, median=0.002, p99=0.004)
        stats.add([sample(pair, at=1.0 if name == "sim" else 9.0)])
    stats.add([sample(robot.plant(PLANT_STATE, 0, 0, 0), at=9.0)])
    seen = stats.snapshot(10 * SECOND)
    assert [(s.health.service, s.alive) for s in seen.services] == [("sim", False), ("wbc", True)]
    rows = {row.name: row for row in seen.topics}
    assert rows["plant/state"].refused == 2  # one by each of the two services
    assert rows[HEALTH.name].messages == 2
    assert rows[HEALTH.name].nominal == 2 * HEALTH.rate
    assert HEALTH_TIMEOUT > WINDOW


def test_other_keys_and_undecodable_messages_do_no_harm() -> None:
    robot, stats = FakeRobot(), BusStats("draco3")
    good = sample(robot.status(), at=1.0)
    stats.add([RawSample("draco3/nonsense", b"x", "", 1), good._replace(key="other/plant/status")])
    assert stats.snapshot(SECOND).topics == ()
    stats.add([good._replace(payload=b"\xc1garbage")])
    seen = stats.snapshot(SECOND)
    assert seen.plant is None
    assert seen.topics[0].messages == 1
    stats.add([good])
    assert stats.latest(PLANT_STATUS) is not None


def everything() -> BusStats:
    robot, stats = FakeRobot(), BusStats("draco3")
    operator = OperatorStatus(script="demo", step=4, steps=8, label="a mark", finished=False)
    pairs = [
        robot.plant(PLANT_STATE, 0, 0, 0),
        robot.status(),
        robot.wbc(),
        robot.health("wbc", misses=7, median=0.002, p99=0.004),
        (TELEOP_STATUS, operator),
    ]
    stats.add([sample(pair, at=1.0) for pair in pairs])
    return stats


def beat(robot: FakeRobot, source: str, timeout: float) -> Pair:
    header = robot.header(HEARTBEAT, source)
    return HEARTBEAT, Heartbeat(header=header, steps=1, timeout=timeout)


def watched() -> BusStats:
    """Everything, and a controller whose inputs are delayed and whose peers are not well."""
    stats = everything()
    stages = [
        StageTime(stage="wire", median=0.0012, p99=0.0034),
        StageTime(stage="total", median=0.113, p99=0.134),
    ]
    topics = ["teleop/setpoint", "camera/left", "plant/state", *(f"extra/{n}" for n in range(20))]
    links = [
        LinkHealth(
            topic=topic, received=9, rate=20.0, age=0.01, gaps=0, refused=0, stale=3,
            stages=stages, **(INJECTED if topic == "teleop/setpoint" else {}),
        )
        for topic in topics
    ]  # fmt: skip
    peers = [
        PeerHealth(source="sim", alive=True, silent=0.03, clock_error=0.0),
        PeerHealth(source="teleop", alive=False, silent=2.5, losses=1, clock_error=0.0),
        PeerHealth(source="far", alive=True, silent=0.0, clock_offset=-0.2, clock_error=4e-4),
        PeerHealth(source="strange", alive=True, silent=0.0),
        PeerHealth(source="beatless", alive=False, silent=-1.0, clock_error=0.0),
    ]
    header = Header(source="wbc", boot=9)
    update = {"links": links, "peers": peers, "header": header}
    health = example_health("wbc").model_copy(update=update)
    stats.add([sample((HEALTH, health), at=1.0)])
    return stats


INJECTED: dict[str, Any] = {
    "link": "normal(250ms, 20ms)",
    "requested_mean": 0.25,
    "requested_p99": 0.2965,
    "achieved_mean": 0.2512,
    "achieved_p99": 0.2977,
    "lost": 17,
}


def lines_of(view: Snapshot, **options: Any) -> list[str]:
    out = io.StringIO()
    Console(file=out, width=100).print(render_table(view, "the title", **options))
    return [text.rstrip() for text in out.getvalue().splitlines()]


def test_ledger_links_and_peers_are_shown() -> None:
    lines = lines_of(watched().snapshot(SECOND))
    (setpoint,) = (text for text in lines if text.startswith("teleop/setpoint > wbc  "))
    assert setpoint.split()[3:] == ["-", "-", "1.2/3.4", "-", "-", "-", "-", "113/134"]
    (link,) = (text for text in lines if "normal(250ms, 20ms)" in text)
    assert link.split()[-5:] == ["250.0", "296.5", "251.2", "297.7", "17"]
    text = "\n".join(lines)
    for words in ("silent 2.5 s", "-200.000 ± 0.400 ms", "unknown"):
        assert words in text
    assert "beatless" not in text
    # Only peers with problems are shown, and "sim" has none.
    assert sum(line.startswith("sim ") for line in lines) == 0
    assert max(len(line) for line in lines) <= 100
    row = next(
        line.split() for line in lines if line.startswith("plant/state ") and ">" not in line
    )
    assert row[-2:] == ["3", "0"]


@pytest.mark.parametrize("height", [24, 30, 39, 80])
def test_it_fits_its_terminal_and_says_what_is_left_out(height: int) -> None:
    lines = lines_of(watched().snapshot(SECOND), height=height)
    assert len(lines) <= height
    text = "\n".join(lines)
    if height < 50:
        assert "of 23, --ledger)" in text
    # The most important stays.
    assert "teleop/setpoint > wbc" in text
    assert "plant/state" in text


def test_parts_can_be_asked_for() -> None:
    view = watched().snapshot(SECOND)
    ledger = lines_of(view, content=Content.LEDGER)
    assert sum("> wbc" in text for text in ledger) == 23
    assert not any(text.startswith("health") for text in ledger)
    topics = lines_of(view, content=Content.TOPICS, height=40)
    assert any(text.startswith("health") for text in topics)
    assert not any("> wbc" in text for text in topics)


@pytest.mark.parametrize(
    ("lines", "topics", "ledger", "shares"),
    [
        (30, 10, 10, (10, 10)),
        (20, 18, 14, (10, 10)),
        (20, 18, 4, (16, 4)),
        (20, 5, 30, (5, 15)),
        (20, 18, 0, (18, 0)),
        (-3, 9, 9, (1, 1)),
    ],
)
def test_two_tables_share_the_room(
    lines: int, topics: int, ledger: int, shares: tuple[int, int]
) -> None:
    assert share_lines(lines, topics, ledger) == shares


def test_the_line_tells_of_the_dead_and_of_latency() -> None:
    text = format_line(watched().snapshot(SECOND))
    assert "set-point to wbc 113/134 ms" in text
    assert "too old 3" in text
    assert "silent: wbc" in format_line(watched().snapshot(9 * SECOND))


def test_the_table_shows_what_matters() -> None:
    out = io.StringIO()
    Console(file=out, width=100).print(render_table(everything().snapshot(SECOND), "the title"))
    text = out.getvalue()
    for words in (
        "the title",
        "BALANCE",
        "guard ACTIVE",
        "real-time factor 1.00",
        "state age at torque 4.0 ms",
        "demo 4/8 a mark",
        "plant/state",
        "alive",
    ):
        assert words in text
    assert len(text.splitlines()) <= 24


def test_the_line_shows_what_matters() -> None:
    text = format_line(everything().snapshot(10 * SECOND))
    assert "step 4/8 'a mark'" in text
    assert "stale: plant/state" in text
    assert "deadline misses 7" in text


def test_an_empty_bus_is_shown_too() -> None:
    view = BusStats("draco3").snapshot(0)
    out = io.StringIO()
    Console(file=out, width=80).print(render_table(view, "t"))
    assert "nothing heard yet" in out.getvalue()
    assert "nothing heard yet" in format_line(view)
