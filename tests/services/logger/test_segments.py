from pathlib import Path

from services.logger.read.segments import existing_segments, next_segment


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
