from pathlib import Path

from services.logger.read.parts import existing_parts, next_part


def test_parts_are_numbered_and_found_in_order(tmp_path: Path) -> None:
    first = tmp_path / "log.mcap"
    assert next_part(first) == first
    assert existing_parts(first) == [first]
    written = []
    for _ in range(3):
        path = next_part(first)
        path.write_bytes(b"x")
        written.append(path)
    assert [path.name for path in written] == ["log.mcap", "log-2.mcap", "log-3.mcap"]
    assert existing_parts(first) == written
    assert next_part(first).name == "log-4.mcap"
