"""The summary of a log, with and without its index."""

from pathlib import Path

import pytest

from common.schemas import AuthorityChange, OperatorKind
from services.logger.errors import LoggerError
from services.logger.read.index import read_index
from services.logger.read.info import read_info
from services.logger.read.mcap_file import McapFile, Span
from services.logger.record.config import LoggerConfig
from services.logger.repair.repair import repair
from tests.common.operator.support import said
from tests.services.logger.support import (
    DISCARD,
    END,
    START,
    gait,
    link,
    mark,
    picture,
    record,
    sample,
)


def make(path: Path) -> None:
    samples = [gait(seq, at=10**9 * (1 + seq)) for seq in (0, 1, 2, 5)]
    samples += [picture(seq, at=10**9 + 10**8 * seq) for seq in range(31)]
    samples += [
        mark(0, 0, START, 2 * 10**9, "door"),
        link(0, 25 * 10**8, "250ms"),
        mark(1, 0, END, 3 * 10**9),
        mark(2, 1, START, 4 * 10**9, "again"),
        mark(3, 1, DISCARD, 5 * 10**9),
        mark(4, 2, START, 55 * 10**8, "open"),
    ]
    samples.sort(key=lambda one: one.arrival_ns)
    record(path, samples, LoggerConfig(chunk_size=10_000))


@pytest.fixture(params=["whole", "cut off"])
def log(request: pytest.FixtureRequest, tmp_path: Path) -> Path:
    path = tmp_path / "log.mcap"
    make(path)
    if request.param == "cut off":
        # All messages are there, but neither statistics nor index.
        index = read_index(path)
        data = path.read_bytes()
        statistics = data.index(b"account", index.places[-1].offset)
        path.write_bytes(data[: statistics - 20])
        assert not read_index(path).whole
    return path


def test_topics_services_episodes_and_links(log: Path) -> None:
    info = read_info(log)
    topics = {one.key.removeprefix("draco3/"): one for one in info.topics}
    assert {name: one.messages for name, one in topics.items()} == {
        "teleop/gait": 4,
        "camera/left": 31,
        "episode": 5,
        "link/wbc": 1,
    }
    camera = topics["camera/left"]
    assert camera.rate == pytest.approx(10.0)
    assert camera.schemas == ("CameraFrame/1",)
    assert camera.count.bytes > 31 * 5000
    assert (topics["teleop/gait"].count.sent, topics["teleop/gait"].count.lost) == (6, 2)
    assert info.boots == {"camera": [1], "s": [1], "teleop": [1], "wbc": [1]}
    assert [(e.label, e.outcome) for e in info.episodes[:2]] == [
        ("door", "complete"),
        ("again", "discarded"),
    ]
    assert [(one.at_ns, one.change.link) for one in info.links] == [(25 * 10**8, "250ms")]
    assert (info.segments[0].start_ns, info.segments[0].end_ns) == (10**9, 6 * 10**9)
    assert info.origin["robot"] == "draco3"


def test_the_open_episode(tmp_path: Path) -> None:
    make(tmp_path / "log.mcap")
    # The recorder was stopped while it ran.
    assert read_info(tmp_path / "log.mcap").episodes[-1].outcome == "interrupted"


def test_wall_clock(log: Path) -> None:
    part = read_info(log).segments[0]
    assert part.wall_ns(int(part.origin["monotonic_ns"])) == int(part.origin["wall_ns"])


def test_a_whole_log_is_not_read_through(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    make(path)
    index = read_index(path)
    marks = {number for number, one in index.channels.items() if "camera" not in one.topic}
    data = bytearray(path.read_bytes())
    spoilt = 0
    for place in index.places:
        if place.channels.isdisjoint(marks):
            data[place.offset + 100] ^= 0xFF
            spoilt += 1
    assert spoilt > 3
    before = read_info(path)
    path.write_bytes(data)
    assert read_info(path) == before


def test_what_is_no_log(tmp_path: Path) -> None:
    with pytest.raises(LoggerError, match="cannot open the log"):
        read_info(tmp_path / "none.mcap")
    (tmp_path / "text.mcap").write_text("this is no log")
    with pytest.raises(LoggerError, match="not an MCAP log"):
        read_info(tmp_path / "text.mcap")
    (tmp_path / "empty.mcap").write_bytes(b"")
    with pytest.raises(LoggerError, match="empty"):
        read_info(tmp_path / "empty.mcap")


def test_who_had_the_robot_is_found_without_reading_the_chunks_between(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    person = OperatorKind.PERSON
    states = {0: said(1, AuthorityChange.GRANTED, "policy")} | {
        300: said(2, AuthorityChange.TAKEN, "keyboard", person),
        310: said(3, AuthorityChange.RELEASED),
        311: said(4, AuthorityChange.GRANTED, "policy"),
    }
    last, samples = states[0], []
    for number in range(640):
        last = states.get(number, last)
        samples.append(sample("wbc/authority", last, number, 10**9 + 10**8 * number, "wbc"))
    path = tmp_path / "log.mcap"
    record(path, samples, LoggerConfig(chunk_size=2000))
    info = read_info(path)
    assert [(h.holder.source, h.start, h.intervention) for h in info.holds] == [
        ("policy", 10**9, False),
        ("keyboard", 31 * 10**9, True),
        ("policy", 32.1 * 10**9, False),
    ]
    assert [h.end for h in info.holds] == [31 * 10**9, 32 * 10**9, None]

    read, chunk_data = [0], McapFile.chunk_data

    def counted(file: McapFile, span: Span) -> bytes:
        read[0] += 1
        return chunk_data(file, span)

    monkeypatch.setattr(McapFile, "chunk_data", counted)
    assert read_info(path).holds == info.holds
    assert read[0] < len(read_index(path).places) / 3


@pytest.mark.parametrize(("size", "readable"), [(8, False), (40, False), (1200, True)])
def test_what_a_repair_could_not_save_is_told(tmp_path: Path, size: int, *, readable: bool) -> None:
    path = tmp_path / "log.mcap"
    make(path)
    path.write_bytes(path.read_bytes()[:size])
    assert read_info(path).segments[0].readable is readable
    if readable:
        repair(path)
    else:
        with pytest.raises(LoggerError, match="nothing in it can be read"):
            repair(path)
