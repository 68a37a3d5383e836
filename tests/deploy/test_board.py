"""What the live table says about a bus with known traffic."""

import io

import pytest
from rich.console import Console

from common.bus.codec import encode, schema_tag
from common.bus.keys import key_of
from common.bus.tap import RawSample
from common.schemas import OperatorStatus
from common.topics import HEALTH, PLANT_STATE, PLANT_STATUS, TELEOP_STATUS
from deploy.board import DEAD_AFTER, WINDOW, Board
from deploy.table import draw, line
from tests.deploy.synthetic import Life, Pair

SECOND = 1_000_000_000


def sample(pair: Pair, at: float, robot: str = "draco3") -> RawSample:
    topic, message = pair
    key = key_of(robot, topic, message.header.source)
    tag = schema_tag(type(message))
    return RawSample(key, encode(message, message.header), tag, round(at * SECOND))


def test_rate_age_and_gaps() -> None:
    life, board = Life(), Board("draco3")
    for number in range(100):
        skip = 4 if number == 50 else 0
        pair = life.plant(PLANT_STATE, 0, 0, 0, skip=skip)
        board.note([sample(pair, at=number * 0.05)])
    (row,) = board.view(5 * SECOND).topics
    assert row.name == "plant/state"
    assert row.rate == pytest.approx(20.0, rel=0.05)
    assert row.age == pytest.approx(0.05)
    assert (row.messages, row.gaps, row.stale) == (100, 4, False)
    (row,) = board.view(9 * SECOND).topics
    assert row.rate == 0.0
    assert row.stale


def test_services_and_what_their_readers_refuse() -> None:
    life, board = Life(), Board("draco3")
    for name in ("wbc", "sim"):
        pair = life.health(name, misses=3, median=0.002, p99=0.004)
        board.note([sample(pair, at=1.0 if name == "sim" else 9.0)])
    board.note([sample(life.plant(PLANT_STATE, 0, 0, 0), at=9.0)])
    seen = board.view(10 * SECOND)
    assert [(s.health.service, s.alive) for s in seen.services] == [("sim", False), ("wbc", True)]
    rows = {row.name: row for row in seen.topics}
    assert rows["plant/state"].refused == 2  # one by each of the two services
    assert rows[HEALTH.name].messages == 2
    assert rows[HEALTH.name].nominal == 2 * HEALTH.rate
    assert DEAD_AFTER > WINDOW


def test_other_keys_and_undecodable_messages_do_no_harm() -> None:
    life, board = Life(), Board("draco3")
    good = sample(life.status(), at=1.0)
    board.note([RawSample("draco3/nonsense", b"x", "", 1), good._replace(key="other/plant/status")])
    assert board.view(SECOND).topics == ()
    board.note([good._replace(payload=b"\xc1garbage")])
    seen = board.view(SECOND)
    assert seen.plant is None
    assert seen.topics[0].messages == 1
    board.note([good])
    assert board.latest(PLANT_STATUS) is not None


def everything() -> Board:
    life, board = Life(), Board("draco3")
    operator = OperatorStatus(script="demo", step=4, steps=8, label="a mark", finished=False)
    pairs = [
        life.plant(PLANT_STATE, 0, 0, 0),
        life.status(),
        life.wbc(),
        life.health("wbc", misses=7, median=0.002, p99=0.004),
        (TELEOP_STATUS, operator),
    ]
    board.note([sample(pair, at=1.0) for pair in pairs])
    return board


def test_the_table_shows_what_matters() -> None:
    out = io.StringIO()
    Console(file=out, width=100).print(draw(everything().view(SECOND), "the title"))
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
    text = line(everything().view(10 * SECOND))
    assert "step 4/8 'a mark'" in text
    assert "stale: plant/state" in text
    assert "deadline misses 7" in text


def test_an_empty_bus_is_shown_too() -> None:
    view = Board("draco3").view(0)
    out = io.StringIO()
    Console(file=out, width=80).print(draw(view, "t"))
    assert "nothing heard yet" in out.getvalue()
    assert "nothing heard yet" in line(view)
