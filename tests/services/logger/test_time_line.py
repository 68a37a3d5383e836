"""One time line through segments whose clocks differ, the same for every reader."""

from pathlib import Path

import pytest
from mcap.reader import make_reader

from common.transport.tap import RawSample
from lab.logs.log_text import info_lines
from lab.logs.playback import Player, PlayOptions, extent_of
from services.logger.export.convert import export_log
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.read.time_line import PAUSE_NS, TimeLine
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from tests.services.logger.support import END, START, gait, mark

S = 1_000_000_000
WALL = 1_800_000_000 * S


def origin(
    session: str, boot: str = "b1", at: int = 0, wall: int = WALL, slept: int = 0
) -> dict[str, str]:
    """The first record of a segment begun at monotonic ``at`` [ns] and wall clock ``wall``."""
    times = {"monotonic_ns": at, "wall_ns": wall, "boottime_ns": at + slept}
    return {"session": session, "boot_id": boot} | {name: str(v) for name, v in times.items()}


def joined(first: dict[str, str], second: dict[str, str], last: int, then: int) -> TimeLine:
    """The time line after messages at 100 s to ``last`` and a second segment from ``then``."""
    line = TimeLine()
    line.begin_segment("log.mcap", first)
    assert line.place(100 * S) == 100 * S
    line.place(last)
    line.begin_segment("log-2.mcap", second)
    line.place(then)
    return line


def test_a_rotation_and_a_quick_restart_change_nothing() -> None:
    rotated = joined(origin("a", at=99 * S), origin("a", at=99 * S), 200 * S, 200 * S - 5)
    assert (rotated.shift_ns, rotated.pauses) == (0, [])
    # The wall clock was set back by two hours meanwhile: within one boot it does not matter.
    again = origin("b", at=201 * S, wall=WALL - 7000 * S)
    restarted = joined(origin("a", at=99 * S), again, 200 * S, 201 * S)
    assert (restarted.shift_ns, restarted.pauses) == (0, [])
    assert restarted.wall_offset_ns == WALL - 99 * S


def test_a_pause_within_a_boot_is_shortened_and_told() -> None:
    line = joined(origin("a"), origin("b", at=11_000 * S), 200 * S, 11_000 * S)
    (pause,) = line.pauses
    assert (pause.real_ns, pause.counted_ns) == (10_800 * S, PAUSE_NS)
    assert line.place(11_000 * S) == 200 * S + PAUSE_NS == pause.at_ns
    assert "3:00:00" in str(pause)


def test_a_suspended_machine_moves_the_wall_clock_only() -> None:
    line = joined(origin("a"), origin("b", at=201 * S, slept=7200 * S), 200 * S, 201 * S)
    assert line.pauses[0].real_ns == 7201 * S
    assert line.wall_offset_ns == WALL + 7200 * S
    # Also while one process recorded, for which the time passed at once.
    line = joined(origin("a"), origin("a", at=201 * S, slept=7200 * S), 200 * S, 201 * S)
    assert (line.pauses, line.shift_ns) == ([], 0)
    assert line.wall_offset_ns == WALL + 7200 * S


def test_another_boot_goes_on_where_the_first_ended() -> None:
    # 60 s after the end by the wall clock; its monotonic clock has just begun.
    second = origin("b", "b2", at=20 * S, wall=WALL + 260 * S)
    line = joined(origin("a"), second, 200 * S, 20 * S)
    assert line.place(21 * S) == 202 * S
    assert line.pauses[0].real_ns == 60 * S
    assert line.wall_offset_ns == WALL + 240 * S
    # A later monotonic clock of another boot is no pause either.
    second = origin("b", "b2", at=90_000 * S, wall=WALL + 201 * S)
    assert joined(origin("a"), second, 200 * S, 90_000 * S).pauses == []


def test_a_wall_clock_that_went_back_never_turns_time_round() -> None:
    second = origin("b", "b2", at=20 * S, wall=WALL - 7200 * S)
    line = joined(origin("a"), second, 200 * S, 20 * S)
    assert line.pauses[0].real_ns is None
    assert line.place(20 * S) == 200 * S
    assert line.wall_offset_ns is not None
    assert 20 * S + line.wall_offset_ns == WALL + 200 * S


def test_logs_that_do_not_name_the_boot() -> None:
    old = [{k: v for k, v in origin(*o).items() if k != "boot_id"} for o in [("a",), ("b",)]]
    assert joined(old[0], old[1], 200 * S, 201 * S).shift_ns == 0
    line = joined(old[0], old[1], 200 * S, 20 * S)
    assert line.place(20 * S) == 200 * S
    assert joined({}, {}, 200 * S, 150 * S).place(150 * S) == 200 * S


def part(path: Path, start: dict[str, str], arrivals: list[RawSample]) -> None:
    from common.wire.header import wire_header

    sink = McapSink(path, "draco3", LoggerConfig(), start)
    for one in arrivals:
        sink.write(one, wire_header(one.payload))
    sink.close()


@pytest.fixture
def rebooted(tmp_path: Path) -> Path:
    """1 s at 100 Hz, after a day of the machine; 1 s more after its restart and two hours back."""
    late, early = 100_000 * S, 50 * S
    first = [gait(i, at=late + i * S // 100) for i in range(100)]
    second = [gait(100 + i, at=early + i * S // 100) for i in range(100)]
    second.insert(10, mark(0, 0, START, early + S // 10, "again"))
    second.append(mark(1, 0, END, early + S))
    part(tmp_path / "log.mcap", origin("a", "b1", late), first)
    part(tmp_path / "log-2.mcap", origin("b", "b2", early, WALL - 7200 * S), second)
    return tmp_path / "log.mcap"


def test_every_reader_has_the_same_time_line(rebooted: Path) -> None:
    messages = list(LogReader(rebooted).raw_messages())
    times = [one.time_ns for one in messages]
    assert times == sorted(times)
    assert times[-1] - times[0] == 990 * S // 1000 + S
    info = read_info(rebooted)
    assert (info.segments[0].start_ns, info.segments[1].end_ns) == (times[0], times[-1])
    rates = {one.key: one.rate for one in info.topics}
    assert rates["draco3/teleop/gait"] == pytest.approx(100.0)
    (episode,) = info.episodes
    assert 1e-9 * (episode.start_ns - times[0]) == pytest.approx(1.09)
    assert episode.seconds == pytest.approx(0.9)
    assert any("unknown length before log-2.mcap" in line for line in info_lines(info))
    # What is published takes two seconds, not a day.
    assert extent_of(rebooted).seconds == pytest.approx(1.99)


def test_a_replay_does_not_wait_where_the_clock_changed(
    rebooted: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    published: list[int] = []
    monkeypatch.setattr(Player, "_publish", lambda _, raw: published.append(raw.sequence))
    options = PlayOptions(speed=100.0)
    places = list(Player(None, rebooted, extent_of(rebooted), options).play())
    assert len(published) == 202
    assert places == sorted(places)
    assert places[-1] == pytest.approx(1.99)


def test_exported_times_never_go_back(rebooted: Path, tmp_path: Path) -> None:
    summary = export_log(rebooted, tmp_path / "out.mcap")
    assert summary.duration == pytest.approx(1.99)
    with (tmp_path / "out.mcap").open("rb") as stream:
        messages = make_reader(stream).iter_messages(log_time_order=False)
        times = [(message.log_time, message.publish_time) for _, _, message in messages]
    assert times == sorted(times)
    assert times[0][0] == WALL
    assert times[-1][0] == WALL + 1_990_000_000
    assert all(published <= logged for logged, published in times)
