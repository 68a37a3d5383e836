"""Logs of other MCAP writers, whose messages may stand outside chunks."""

from pathlib import Path

import pytest

from lab.logs.log_text import repair_lines
from services.logger.read.index import read_index
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader
from services.logger.repair import repair as repair_module
from services.logger.repair.repair import repair
from services.logger.repair.verify import fault_of
from tests.services.logger.support import write_foreign


def test_messages_outside_chunks_are_read_and_counted(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_foreign(path)
    assert fault_of(path) == ""
    info = read_info(path)
    (segment,), (topic,) = info.segments, info.topics
    assert (segment.messages, segment.whole) == (100, True)
    assert (segment.start_ns, segment.end_ns) == (10**9, 10**9 + 99 * 10**7)
    assert topic.messages == 100
    assert topic.rate == pytest.approx(100.0)
    assert [m.sequence for m in LogReader(path).raw_messages()] == list(range(100))
    index = read_index(path)
    assert len(index.places) == 1
    assert [m.sequence for _, m in index.messages(lambda _: True)] == list(range(100))


def test_a_whole_file_without_chunks_is_left_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_foreign(path)
    before = path.read_bytes()
    assert repair(path, discard_original=True).fault == ""
    assert path.read_bytes() == before


def test_a_cut_file_without_chunks_keeps_its_messages(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    write_foreign(path)
    data = path.read_bytes()
    # In the middle of the messages; each takes 33 bytes.
    path.write_bytes(data[: data.index(b"{}", 2000) + 33 * 40])
    before = sum(1 for _ in LogReader(path).raw_messages())
    assert 40 < before < 100
    done = repair(path, discard_original=True)
    assert (done.messages, done.stated, done.kept) == (before, 0, None)
    assert [m.sequence for m in LogReader(path).raw_messages()] == list(range(before))


@pytest.mark.parametrize("end", ["whole", "cut off"])
def test_an_original_with_more_messages_than_come_out_is_never_discarded(
    tmp_path: Path, end: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "log.mcap"
    write_foreign(path, chunked=True)
    data = bytearray(path.read_bytes())
    if end == "whole":
        # The one chunk is damaged; the statistics at the end still count its messages.
        data[read_index(path).places[0].offset + 60] ^= 0xFF
    else:
        # Cut behind the chunk, and this project's reader is made blind to chunks.
        del data[read_index(path).places[0].end + 5 :]
        monkeypatch.setattr(repair_module, "recover", lambda *_, **__: iter(_header(path)))
    path.write_bytes(data)
    done = repair(path, discard_original=True)
    assert (done.messages, done.stated) == (0, 100)
    assert done.kept is not None
    assert done.kept.read_bytes() == bytes(data)
    assert any("NOT ALL" in line for line in repair_lines(done))


def _header(path: Path) -> list[object]:
    from services.logger.read.mcap_file import open_mcap

    with open_mcap(path) as file:
        span = next(file.spans())
        return [(span, record) for record in file.records(span)]
