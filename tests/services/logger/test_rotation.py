"""A long recording continues in further segments; nothing is lost or doubled between them."""

from pathlib import Path

import pytest
from mcap.reader import make_reader

from common.transport.schema_query import Description
from common.transport.tap import RawSample
from services.logger.errors import LoggerError
from services.logger.read.delivery import total
from services.logger.read.index import read_index
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.read.segments import existing_segments, next_segment
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink
from services.logger.repair.repair import repair
from services.logger.repair.verify import fault_of
from tests.services.logger.support import END, START, gait, mark, picture


def record_segments(path: Path, config: LoggerConfig, batches: list[list[RawSample]]) -> Recorder:
    def new_segment() -> McapSink:
        return McapSink(next_segment(path), "draco3", config, {"session": "s1"})

    recorder = Recorder(new_segment(), config, next_sink=new_segment)
    for batch in batches:
        for one in batch:
            recorder.intake.offer(one)
        recorder._drain()
    recorder.start()
    recorder.stop()
    return recorder


def samples(count: int = 300) -> list[RawSample]:
    made = [one(seq, at=1000 + 10 * seq) for seq in range(count) for one in (gait, picture)]
    # An episode that crosses the first seam, and one within a part.
    made.insert(20, mark(0, 0, START, 1100, "long"))
    made.insert(400, mark(1, 0, END, 2900))
    return made


@pytest.fixture
def segments(tmp_path: Path) -> list[Path]:
    config = LoggerConfig(rotate_size=400_000, chunk_size=20_000)
    record_segments(tmp_path / "log.mcap", config, [samples()])
    return existing_segments(tmp_path / "log.mcap")


def test_nothing_is_lost_or_doubled_at_the_seams(segments: list[Path]) -> None:
    assert len(segments) > 3
    expected = [one.payload for one in samples()]
    assert [entry.payload for entry in LogReader(segments[0]).raw_messages()] == expected
    found = []
    for path in segments:
        assert fault_of(path) == ""
        with path.open("rb") as stream:
            messages = list(make_reader(stream, validate_crcs=True).iter_messages(None))
        assert messages, path
        # Each segment has its schemas.
        assert all(schema is not None for schema, _, _ in messages)
        found += [message.data for _, _, message in messages]
        assert path.stat().st_size < 500_000
    assert sorted(found) == sorted(expected)


def test_delivery_is_counted_over_all_segments(segments: list[Path]) -> None:
    info = read_info(segments[0])
    assert total({one.key: one.count for one in info.topics}).sent == len(samples())
    assert sum(one.messages for one in info.topics) == len(samples())
    reader = LogReader(segments[0])
    assert sum(1 for _ in reader.raw_messages()) == len(samples())
    # The statistics in the last segment are of all of them.
    assert total(reader.report).recorded == len(samples())


def test_an_episode_across_a_seam_is_one(segments: list[Path]) -> None:
    (episode,) = read_info(segments[0]).episodes
    assert (episode.label, episode.start_ns, episode.end_ns) == ("long", 1100, 2900)
    assert episode.outcome == "complete"
    # A later segment alone has what it carries of the earlier ones.
    alone = [read_info(path).episodes for path in segments[1:]]
    end = alone.index([episode])
    assert all([one.outcome for one in found] == ["open"] for found in alone[:end])
    assert not any(alone[end + 1 :])


def test_a_killed_last_segment_is_repaired_with_the_statistics_of_all(segments: list[Path]) -> None:
    data = segments[-1].read_bytes()
    segments[-1].write_bytes(data[: len(data) // 2])
    before = read_info(segments[0])
    assert not before.whole
    done = repair(segments[-1])
    after = total(done.report)
    assert after.lost == after.dropped == 0
    assert after.recorded == sum(1 for _ in LogReader(segments[0]).raw_messages())
    assert after.recorded < len(samples())
    assert read_info(segments[0]).topics == before.topics


def test_a_new_segment_is_due_after_some_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now = [100.0]
    monkeypatch.setattr("services.logger.record.recorder.time.monotonic", lambda: now[0])
    config = LoggerConfig(rotate_every=10.0)
    path = tmp_path / "log.mcap"

    def new_segment() -> McapSink:
        return McapSink(next_segment(path), "draco3", config)

    recorder = Recorder(new_segment(), config, next_sink=new_segment)
    for seq in range(5):
        recorder.intake.offer(gait(seq))
        recorder._drain()
        now[0] += 6.0
    monkeypatch.undo()
    recorder.start()
    recorder.stop()
    # At 100, 106 and 112, which is more than 10 s after 100; at 118 and 124.
    assert [read_index(one).counts.total() for one in existing_segments(path)] == [3, 2, 0]


def test_a_recording_that_goes_on_after_a_crash_interrupts_the_episode(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    for number, batch in enumerate(
        ([mark(0, 0, START, 1000, "cut"), gait(0, at=1500)], [gait(9, at=9000)])
    ):
        sink = McapSink(next_segment(path), "draco3", LoggerConfig(), {"session": f"s{number}"})
        recorder = Recorder(sink, LoggerConfig())
        for one in batch:
            recorder._record(one)
        sink.flush()
        sink.abandon()
    (episode,) = read_info(path).episodes
    assert (episode.outcome, episode.end_ns) == ("interrupted", 1500)


def test_every_segment_has_the_schema_that_a_sender_gave_once(tmp_path: Path) -> None:
    key, tag = "draco3/experiment/one", "private/1"
    path = tmp_path / "log.mcap"

    config = LoggerConfig(rotate_size=100_000, chunk_size=20_000)

    def new_segment() -> McapSink:
        return McapSink(next_segment(path), "draco3", config)

    recorder = Recorder(new_segment(), config, next_sink=new_segment)
    recorder.describe({key: Description(tag=tag, jsonschema='{"type": "object"}')})
    for number in range(100):
        recorder.intake.offer(RawSample(key, picture(number).payload, tag, number + 1))
    recorder.start()
    recorder.stop()
    segments = existing_segments(path)
    assert len(segments) > 3
    found = []
    for segment in segments:
        with segment.open("rb") as stream:
            messages = make_reader(stream).iter_messages()
            found += [schema.name if schema else "" for schema, _, _ in messages]
    assert found == ["private/1"] * 100


def test_a_recorder_that_fails_unexpectedly_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorder = Recorder(McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig()), LoggerConfig())

    def fail(*_: object) -> None:
        raise ValueError("no such luck")

    monkeypatch.setattr(recorder.episodes, "observe", fail)
    recorder.intake.offer(gait(0))
    recorder.intake.offer(mark(0, 0, START, 1100))
    recorder.start()
    with pytest.raises(LoggerError, match=r"log.mcap failed: ValueError: no such luck"):
        recorder.stop()
    assert recorder.error is not None
