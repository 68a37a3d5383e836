from pathlib import Path

import pytest
from pydantic import ValidationError

from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.read.segments import existing_segments, find_segments, next_segment
from services.logger.record.config import LoggerConfig
from services.logger.record.files import RecordingFiles
from tests.services.logger.support import gait, write, write_foreign


def make(path: Path, count: int, session: str, config: LoggerConfig | None = None) -> None:
    """``count`` segments of one process, of 100 messages each."""
    from common.wire.header import wire_header

    files = RecordingFiles(path, "draco3", config or LoggerConfig(), session, {})
    for number in range(count):
        sink = files.open_next()
        for seq in range(100 * number, 100 * (number + 1)):
            one = gait(seq, at=10**12 + seq * 10**7)
            sink.write(one, wire_header(one.payload))
        sink.close()


def test_parts_are_numbered_and_found_in_order(tmp_path: Path) -> None:
    first = tmp_path / "log.mcap"
    assert next_segment(first) == first
    assert existing_segments(first) == [first]
    written = []
    for _ in range(3):
        path = next_segment(first)
        path.write_bytes(b"x")
        written.append(path)
    assert [path.name for path in written] == ["log.mcap", "log-2.mcap", "log-3.mcap"]
    assert existing_segments(first) == written
    assert next_segment(first).name == "log-4.mcap"


def test_a_missing_segment_is_told_and_its_number_never_used_again(tmp_path: Path) -> None:
    first = tmp_path / "log.mcap"
    make(first, 5, "one")
    (tmp_path / "log-2.mcap").unlink()
    found = find_segments(first)
    assert [path.name for path in found.paths] == [
        "log.mcap", "log-3.mcap", "log-4.mcap", "log-5.mcap",
    ]  # fmt: skip
    assert found.missing == ["log-2.mcap"]
    assert next_segment(first).name == "log-6.mcap"
    assert sum(1 for _ in LogReader(first).raw_messages()) == 400
    assert any("log-2.mcap is missing" in remark for remark in read_info(first).remarks)


def test_a_recorder_counts_on_although_its_last_segment_was_removed(tmp_path: Path) -> None:
    files = RecordingFiles(tmp_path / "log.mcap", "draco3", LoggerConfig(), "one", {})
    for name in ("log.mcap", "log-2.mcap", "log-3.mcap"):
        sink = files.open_next()
        sink.close()
        assert sink.path.name == name
        sink.path.unlink()


def test_files_of_another_recording_are_left_out_and_told(tmp_path: Path) -> None:
    door = tmp_path / "door.mcap"
    make(door, 1, "one")
    make(tmp_path / "other.mcap", 1, "two")
    (tmp_path / "other.mcap").rename(tmp_path / "door-2.mcap")
    write_foreign(tmp_path / "door-3.mcap")
    found = find_segments(door)
    assert found.paths == [door]
    assert [path.name for path in found.foreign] == ["door-2.mcap", "door-3.mcap"]
    assert sum(1 for _ in LogReader(door).raw_messages()) == 100
    assert len(read_info(door).remarks) == 2
    # A recorder that goes on there overwrites neither.
    make(door, 1, "three")
    assert [path.name for path in existing_segments(door)] == ["door.mcap", "door-4.mcap"]


def test_segments_of_earlier_versions_belong_by_their_names(tmp_path: Path) -> None:
    for number in ("", "-2"):
        write(tmp_path / f"log{number}.mcap", [gait(0)])
    make(tmp_path / "log.mcap", 1, "new")
    assert len(existing_segments(tmp_path / "log.mcap")) == 3


@pytest.mark.parametrize("limit", [{"keep_segments": 2}, {"keep_size": 205_000}])
def test_the_oldest_segments_are_deleted_beyond_a_limit(
    tmp_path: Path, limit: dict[str, int]
) -> None:
    config = LoggerConfig.model_validate({"rotate_size": 190_000, **limit})
    # Each file is of some 10 kB: the new one's full size counts.
    make(tmp_path / "log.mcap", 5, "one", config)
    kept = existing_segments(tmp_path / "log.mcap")
    assert kept[-1].name == "log-5.mcap"
    assert len(kept) == 2
    assert read_info(tmp_path / "log.mcap").segments[0].path.name == "log-4.mcap"


def test_no_limit_deletes_what_another_recording_has_there(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [gait(0)])
    make(tmp_path / "other.mcap", 1, "two")
    (tmp_path / "other.mcap").rename(tmp_path / "log-2.mcap")
    make(tmp_path / "log.mcap", 4, "one", LoggerConfig(rotate_size=190_000, keep_segments=1))
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "log-2.mcap", "log-6.mcap", "log.mcap",
    ]  # fmt: skip


def test_a_limit_without_rotation_is_refused() -> None:
    with pytest.raises(ValidationError, match="rotate_size"):
        LoggerConfig(keep_segments=3)
