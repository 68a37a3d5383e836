"""The one MCAP reader: info, reading and repair see the same records of a broken file."""

from pathlib import Path

import pytest
from mcap.opcode import Opcode

from services.logger.errors import LoggerError
from services.logger.read.index import read_index
from services.logger.read.info import read_info
from services.logger.read.mcap_file import UNREADABLE, open_mcap
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.repair.repair import repair
from tests.services.logger.support import gait, picture, write


def log_of(path: Path, **config: object) -> bytes:
    """Write 100 messages in several chunks; return the file's bytes."""
    samples = [one(seq, at=1000 + 10 * seq) for seq in range(50) for one in (gait, picture)]
    write(path, samples, LoggerConfig.model_validate({"chunk_size": 40_000, **config}))
    return path.read_bytes()


@pytest.mark.parametrize("compression", ["lz4", "none"])
def test_all_readers_agree_on_a_chunk_that_is_cut_off(tmp_path: Path, compression: str) -> None:
    path = tmp_path / "log.mcap"
    data = log_of(path, compression=compression, chunk_size=120_000)
    chunk = read_index(path).places[1]
    path.write_bytes(data[: chunk.offset + 100_000])
    assert not read_index(path).whole
    reader = LogReader(path)
    found = [one.payload for one in reader.raw_messages()]
    assert reader.truncated
    info = read_info(path)
    assert sum(one.messages for one in info.topics) == len(found)
    assert sum(one.count.recorded for one in info.topics) == len(found)
    assert info.segments[0].end_ns == 1000 + 10 * ((len(found) - 1) // 2)
    done = repair(path)
    assert done.messages == len(found)
    assert 0 < done.losses.partial_messages < 44
    assert [one.payload for one in LogReader(path).raw_messages()] == found


def test_spans_cover_the_file_and_resume_behind_a_hole(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    data = bytearray(log_of(path))
    first, second, *_ = read_index(path).places
    # From the message indexes of the first chunk into the second.
    data[second.offset - 100 : second.offset + 200] = bytes(300)
    path.write_bytes(data)
    with open_mcap(path) as file:
        spans = list(file.spans())
    assert [b.start for b in spans[1:]] == [a.end for a in spans[:-1]]
    assert (spans[0].start, spans[-1].opcode) == (8, Opcode.FOOTER)
    (unreadable,) = [one for one in spans if one.opcode == UNREADABLE]
    assert first.offset < unreadable.start < second.offset
    with pytest.raises(LoggerError, match=r"log\.mcap is damaged.*repair"):
        list(LogReader(path).raw_messages())
    # The first chunk is intact although what stands behind it is not.
    assert repair(path).losses.damaged_chunks == 0
    repaired = [one.log_time for one in LogReader(path).raw_messages()]
    assert repaired[0] == first.start_ns
    assert first.end_ns in repaired
    assert repaired[-1] == 1490


def test_a_wrong_checksum_is_damage(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    data = bytearray(log_of(path, compression="none"))
    chunk = read_index(path).places[1]
    data[chunk.offset + 20_000] ^= 1
    path.write_bytes(data)
    found = []
    with pytest.raises(LoggerError, match=rf"the chunk at byte {chunk.offset} is damaged"):
        found += [one.sequence for one in LogReader(path).raw_messages()]
    assert found == []
    assert repair(path).losses.damaged_chunks == 1


def resident_files() -> int:
    """Size of the mapped files that are in this process's memory [bytes]."""
    status = Path("/proc/self/status").read_text()
    return int(status.partition("RssFile:")[2].split()[0]) * 1024


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="needs /proc")
def test_a_large_file_is_never_in_memory_as_a_whole(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    config = LoggerConfig(compression="none", chunk_size=2**21)
    # The same payload again and again: what matters is the size of the file, 96 MB.
    one = picture(0, size=2_000_000)
    write(path, [one] * 48, config)
    before, most = resident_files(), 0
    with open_mcap(path) as file:
        for span in file.spans():
            for _ in file.records(span):
                most = max(most, resident_files() - before)
    assert 2_000_000 < most < 40_000_000
