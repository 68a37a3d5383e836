"""Whatever is left of a log becomes a whole one, and a whole one is left alone."""

import fcntl
import random
from pathlib import Path

import pytest
from mcap.reader import make_reader

from common.transport.tap import RawSample
from services.logger.errors import LoggerError
from services.logger.read.delivery import total
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink
from services.logger.repair.repair import repair
from services.logger.repair.verify import fault_of
from tests.services.logger.support import END, START, gait, mark, picture, record, write


def arrivals(count: int = 60, size: int = 3000) -> list[RawSample]:
    return [one(seq, at=1000 + 10 * seq) for seq in range(count) for one in (gait, picture)]


def stock_payloads(path: Path) -> list[bytes]:
    with path.open("rb") as stream:
        reader = make_reader(stream, validate_crcs=True)
        assert reader.get_summary() is not None
        return [m.data for _, _, m in reader.iter_messages(log_time_order=False)]


def killed(path: Path, samples: list[RawSample], lost: list[RawSample]) -> None:
    """A file whose recorder was killed after flushing ``samples`` but not ``lost``."""
    sink = McapSink(path, "draco3", LoggerConfig())
    recorder = Recorder(sink, LoggerConfig())
    for one in samples:
        recorder._record(one)
    sink.flush()
    for one in lost:
        recorder._record(one)
    data = path.read_bytes()
    sink.abandon()
    path.write_bytes(data)


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_file_cut_off_anywhere_becomes_whole(tmp_path: Path, compression: str) -> None:
    config = LoggerConfig.model_validate({"compression": compression})
    samples = arrivals()
    write(tmp_path / "whole.mcap", samples, config, flush_each=16)
    data = (tmp_path / "whole.mcap").read_bytes()
    expected = [one.payload for one in samples]
    counts = []
    for cut in [*range(100, len(data) - 1, 9973), len(data) - 1]:
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:cut])
        done = repair(path, discard_original=True)
        assert done.fault
        found = stock_payloads(path)
        assert found == expected[: len(found)]
        assert done.messages == len(found)
        assert total(done.report).sent == total(done.report).recorded == len(found)
        counts.append(len(found))
    assert counts == sorted(counts)
    assert counts[-1] == len(expected)


@pytest.mark.parametrize("compression", ["lz4", "none"])
def test_what_is_left_of_a_chunk_cut_off_is_saved(tmp_path: Path, compression: str) -> None:
    config = LoggerConfig.model_validate({"compression": compression, "chunk_size": 10_000_000})
    samples = arrivals(100)
    write(tmp_path / "log.mcap", samples, config)
    data = (tmp_path / "log.mcap").read_bytes()
    (tmp_path / "log.mcap").write_bytes(data[: len(data) // 2])
    done = repair(tmp_path / "log.mcap")
    assert done.losses.partial_messages == done.messages > 60


def test_zstd_too_block_by_block(tmp_path: Path) -> None:
    samples = [picture(seq, size=20_000) for seq in range(40)]
    write(tmp_path / "log.mcap", samples, LoggerConfig(chunk_size=10_000_000))
    data = (tmp_path / "log.mcap").read_bytes()
    (tmp_path / "log.mcap").write_bytes(data[: 3 * len(data) // 4])
    assert repair(tmp_path / "log.mcap").losses.partial_messages > 20


def test_flipped_bits_cost_a_chunk_that_is_counted_as_lost(tmp_path: Path) -> None:
    samples = arrivals()
    record_path = tmp_path / "log.mcap"
    config = LoggerConfig(chunk_size=20_000)
    record(record_path, samples, config)
    data = record_path.read_bytes()
    expected = [one.payload for one in samples]
    rng = random.Random(3)
    worst = 0
    for _ in range(40):
        damaged = bytearray(data)
        at = rng.randrange(len(data))
        damaged[at] ^= 1 << rng.randrange(8)
        path = tmp_path / "damaged.mcap"
        path.write_bytes(damaged)
        if not fault_of(path):
            # A bit in the text of a metadata record, on which no reader relies.
            continue
        done = repair(path, discard_original=True)
        found = stock_payloads(path)
        assert set(found) <= set(expected)
        assert found == [one for one in expected if one in set(found)]
        count = total(done.report)
        assert count.recorded == len(found)
        assert count.sent == len(expected) or not done.losses.damaged_chunks
        worst = max(worst, len(expected) - len(found))
        assert not fault_of(path)
    assert 0 < worst < 40


def test_a_hole_in_the_middle_is_skipped(tmp_path: Path) -> None:
    samples = arrivals(100)
    write(tmp_path / "log.mcap", samples, LoggerConfig(chunk_size=20_000))
    data = bytearray((tmp_path / "log.mcap").read_bytes())
    third = len(data) // 3
    data[third : third + 30_000] = bytes(30_000)
    (tmp_path / "log.mcap").write_bytes(data)
    done = repair(tmp_path / "log.mcap")
    found = stock_payloads(tmp_path / "log.mcap")
    assert len(samples) // 2 < len(found) < len(samples)
    assert found[-1] == samples[-1].payload
    assert total(done.report).lost == len(samples) - len(found)
    assert done.losses.unreadable_bytes + 20_000 * done.losses.damaged_chunks > 20_000


def test_the_first_chunk_lost_does_not_take_the_topics_with_it(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", arrivals(40), flush_each=20)
    data = (tmp_path / "log.mcap").read_bytes()
    cut = bytearray(data[: 2 * len(data) // 3])  # no index at the end
    cut[600] ^= 0xFF  # in the first chunk
    (tmp_path / "log.mcap").write_bytes(cut)
    done = repair(tmp_path / "log.mcap")
    assert done.losses.damaged_chunks == 1
    assert (done.unknown, done.messages) == (0, 20)
    names = {
        entry.topic.name for entry in LogReader(tmp_path / "log.mcap").raw_messages() if entry.topic
    }
    assert names == {"teleop/gait", "camera/left"}


def test_repairing_twice_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    killed(path, arrivals(20), [])
    assert repair(path).fault == "its end is missing"
    before, stamp = path.read_bytes(), path.stat().st_mtime_ns
    again = repair(path)
    assert (again.fault, again.kept) == ("", None)
    assert (path.read_bytes(), path.stat().st_mtime_ns) == (before, stamp)


def test_the_broken_file_is_kept_and_nothing_else_is_left(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    for expected in ("log.mcap.broken", "log.mcap.broken-2"):
        killed(path, arrivals(5), [])
        broken = path.read_bytes()
        done = repair(path)
        assert done.kept == tmp_path / expected
        assert done.kept.read_bytes() == broken
        path.unlink()
    killed(path, arrivals(5), [])
    assert repair(path, discard_original=True).kept is None
    names = sorted(one.name for one in tmp_path.iterdir())
    assert names == ["log.mcap", "log.mcap.broken", "log.mcap.broken-2"]


def test_out_leaves_the_log_alone(tmp_path: Path) -> None:
    path, out = tmp_path / "log.mcap", tmp_path / "saved.mcap"
    killed(path, arrivals(5), [])
    broken = path.read_bytes()
    assert repair(path, out).output == out
    assert path.read_bytes() == broken
    assert len(stock_payloads(out)) == 10
    with pytest.raises(LoggerError, match="exists already"):
        repair(path, out)
    copy = tmp_path / "copy.mcap"
    assert repair(out, copy).fault == ""
    assert copy.read_bytes() == out.read_bytes()


def test_a_failure_leaves_everything_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.mcap"
    killed(path, arrivals(5), [])
    broken = path.read_bytes()
    monkeypatch.setattr("services.logger.repair.repair.fault_of", lambda *_: "it is no good")
    with pytest.raises(LoggerError, match="does not read back"):
        repair(path)
    assert path.read_bytes() == broken
    assert [one.name for one in tmp_path.iterdir()] == ["log.mcap"]


def test_what_is_being_recorded_is_not_touched(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    sink = McapSink(path, "draco3", LoggerConfig())
    sink.write(gait(0), None)
    sink.flush()
    with pytest.raises(LoggerError, match="still being recorded"):
        repair(path)
    assert read_info(path).segments[0].open
    sink.close()
    assert repair(path).fault == ""
    with path.open("rb") as stream:
        fcntl.flock(stream, fcntl.LOCK_EX)
        with pytest.raises(LoggerError, match="repaired by another"):
            repair(path)


@pytest.mark.parametrize("data", [b"", b"no log at all", bytes(5000)])
def test_what_is_no_log_is_refused_and_kept(tmp_path: Path, data: bytes) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(data)
    with pytest.raises(LoggerError, match="nothing"):
        repair(path)
    assert path.read_bytes() == data
    with pytest.raises(LoggerError, match="cannot open"):
        repair(tmp_path / "none.mcap")


def test_the_open_episode_is_closed_and_the_others_stay(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    marks = [
        mark(0, 0, START, 1000, "a"),
        mark(1, 0, END, 2000),
        mark(2, 1, START, 3000, "b"),
        gait(0, at=4000),
    ]
    killed(path, marks, [mark(3, 1, END, 5000)])
    before = read_info(path)
    assert [(one.episode, one.outcome) for one in before.episodes] == [(0, "complete"), (1, "open")]
    repair(path)
    after = [(one.label, one.start_ns, one.end_ns, one.outcome) for one in read_info(path).episodes]
    assert after == [("a", 1000, 2000, "complete"), ("b", 3000, 4000, "interrupted")]


def test_drops_of_a_killed_recorder_are_counted(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    config = LoggerConfig(queue_messages=4, drain_period=0.02, flush_period=0.02)
    sink = McapSink(path, "draco3", config)
    recorder = Recorder(sink, config)
    for seq in [*range(10), 12]:
        recorder.intake.offer(gait(seq))
    recorder._drain()
    sink.flush()
    data = path.read_bytes()
    sink.abandon()
    path.write_bytes(data)
    count = repair(path).report["draco3/teleop/gait"]
    assert (count.sent, count.recorded, count.dropped, count.lost) == (13, 4, 7, 2)
