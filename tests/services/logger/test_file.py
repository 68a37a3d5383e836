"""What is written comes back, also from a file that is cut off and a disk that is full."""

import json
import os
import time
from pathlib import Path

import pytest
from mcap.reader import make_reader

from common.schemas import CameraFrame, GaitRequest, Header, PlantAction, PlantRequest
from common.transport.tap import RawSample
from common.wire.codec import encode, schema_tag
from services.logger.errors import LoggerError
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink
from tests.services.logger.support import gait, picture, write


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_bytes_times_and_order_come_back(tmp_path: Path, compression: str) -> None:
    arrivals = [gait(0), picture(0), gait(1), picture(1)]
    config = LoggerConfig.model_validate({"compression": compression})
    write(tmp_path / "log.mcap", arrivals, config)
    reader = LogReader(tmp_path / "log.mcap")
    messages = list(reader.raw_messages())
    assert [raw.payload for raw in messages] == [one.payload for one in arrivals]
    assert [raw.key for raw in messages] == [one.key for one in arrivals]
    assert [raw.log_time for raw in messages] == [1000, 1000, 1001, 1001]
    assert [raw.publish_time for raw in messages[::2]] == [999, 1000]
    assert [raw.sequence for raw in messages] == [0, 0, 1, 1]
    assert not reader.truncated
    decoded = [message for _, message in reader.messages()]
    assert isinstance(decoded[2], GaitRequest)
    assert decoded[2].request_id == 1
    assert reader.refused == {}


def test_the_file_explains_itself_to_any_mcap_reader(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [gait(0), gait(1)])
    with (tmp_path / "log.mcap").open("rb") as stream:
        ((schema, channel, _), _) = list(make_reader(stream).iter_messages())
    assert schema is not None
    assert (schema.name, schema.encoding) == ("GaitRequest/1", "jsonschema")
    assert "request_id" in json.loads(schema.data)["properties"]
    assert channel.message_encoding == "msgpack"
    assert channel.metadata["topic"] == "teleop/gait"
    assert channel.metadata["schema_tag"] == schema_tag(GaitRequest)


def test_arrays_shapes_are_in_the_schema(tmp_path: Path) -> None:
    request = PlantRequest(action=PlantAction.PUSH)
    payload = encode(request, Header())
    write(tmp_path / "log.mcap", [RawSample("draco3/plant/request", payload, "", 0)])
    with (tmp_path / "log.mcap").open("rb") as stream:
        ((schema, _, _),) = list(make_reader(stream).iter_messages())
    assert schema is not None
    assert json.loads(schema.data)["properties"]["force"]["x-shape"] == [3]


def test_an_unknown_key_is_recorded_as_it_is(tmp_path: Path) -> None:
    write(tmp_path / "log.mcap", [RawSample("draco3/else", b"\x01\x02", "other", 5)])
    reader = LogReader(tmp_path / "log.mcap")
    (raw,) = reader.raw_messages()
    assert (raw.payload, raw.topic, raw.tag) == (b"\x01\x02", None, "other")
    assert list(reader.messages()) == []


def test_messages_of_another_schema_are_counted_not_decoded(tmp_path: Path) -> None:
    stranger = RawSample("draco3/teleop/gait", picture(0).payload, schema_tag(CameraFrame), 0)
    write(tmp_path / "log.mcap", [gait(0), stranger])
    reader = LogReader(tmp_path / "log.mcap")
    assert len(list(reader.messages())) == 1
    assert reader.refused == {"teleop/gait": 1}
    assert "CameraFrame" in reader.last_refusal


@pytest.mark.parametrize("compression", ["zstd", "lz4", "none"])
def test_a_file_cut_off_anywhere_gives_a_prefix(tmp_path: Path, compression: str) -> None:
    whole = tmp_path / "whole.mcap"
    arrivals = [picture(seq, size=300) for seq in range(40)]
    write(
        whole,
        arrivals,
        LoggerConfig(chunk_size=2000).model_copy(update={"compression": compression}),
    )
    data, expected = whole.read_bytes(), [one.payload for one in arrivals]
    lengths = set()
    # A file that ends before its first record is refused: there is nothing to go on.
    for cut in range(97, len(data) - 1, 97):
        path = tmp_path / "cut.mcap"
        path.write_bytes(data[:cut])
        reader = LogReader(path)
        found = [raw.payload for raw in reader.raw_messages()]
        assert found == expected[: len(found)]
        assert reader.truncated
        lengths.add(len(found))
    assert {0, len(expected)} <= lengths
    assert len(lengths) > 5


def test_flushed_messages_are_readable_while_the_file_is_open(tmp_path: Path) -> None:
    sink = McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig())
    for seq in range(3):
        sink.write(gait(seq), None)
    sink.flush()
    sink.write(gait(3), None)
    reader = LogReader(tmp_path / "log.mcap")
    assert len(list(reader.raw_messages())) == 3
    assert reader.truncated
    sink.close()
    assert len(list(reader.raw_messages())) == 4


def test_report_and_origin_are_in_the_file(tmp_path: Path) -> None:
    recorder = Recorder(McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig()), LoggerConfig())
    for seq in (0, 1, 4):
        recorder.intake.offer(gait(seq))
    recorder.start()
    report = recorder.stop()
    (count,) = report.values()
    assert (count.sent, count.recorded, count.lost, count.dropped) == (5, 3, 2, 0)
    reader = LogReader(tmp_path / "log.mcap")
    assert len(list(reader.raw_messages())) == 3
    assert reader.report == report
    offset = int(reader.origin["wall_ns"]) - int(reader.origin["monotonic_ns"])
    assert abs(offset - (time.time_ns() - time.monotonic_ns())) < 60e9


def test_the_recorder_flushes_by_itself(tmp_path: Path) -> None:
    recorder = Recorder(McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig()), LoggerConfig())
    recorder.start()
    recorder.intake.offer(gait(0))
    reader = LogReader(tmp_path / "log.mcap")
    deadline = time.monotonic() + 10.0
    while not list(reader.raw_messages()):
        assert time.monotonic() < deadline
        time.sleep(0.05)
    recorder.stop()


def test_an_existing_file_is_not_overwritten(tmp_path: Path) -> None:
    path = tmp_path / "log.mcap"
    path.write_bytes(b"precious")
    with pytest.raises(LoggerError, match="exists already"):
        McapSink(path, "draco3", LoggerConfig())
    assert path.read_bytes() == b"precious"


def test_a_directory_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(LoggerError, match=r"cannot write the log .*file/log\.mcap.*--out"):
        McapSink(tmp_path / "file" / "log.mcap", "draco3", LoggerConfig())


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs /dev/full")
def test_a_full_disk_ends_the_recording_with_a_clear_error(tmp_path: Path) -> None:
    sink = McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig())
    # From here on the file behaves as on a full disk.
    full = os.open("/dev/full", os.O_WRONLY)
    os.dup2(full, sink._stream.fileno())
    os.close(full)
    recorder = Recorder(sink, LoggerConfig())
    recorder.start()
    recorder.intake.offer(gait(0))
    deadline = time.monotonic() + 10.0
    while recorder.error is None:
        assert time.monotonic() < deadline
        time.sleep(0.02)
    with pytest.raises(LoggerError, match=r"No space left on device.*free some space .*MiB free"):
        recorder.stop()


def test_what_is_no_log_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LoggerError, match="cannot open"):
        list(LogReader(tmp_path / "none.mcap").raw_messages())
    (tmp_path / "text.mcap").write_text("this is no log at all")
    with pytest.raises(LoggerError, match="not an MCAP log"):
        list(LogReader(tmp_path / "text.mcap").raw_messages())
    for text in ("", "hello"):
        (tmp_path / "short.mcap").write_text(text)
        with pytest.raises(LoggerError, match=f"not an MCAP log.* {len(text)} bytes without any"):
            list(LogReader(tmp_path / "short.mcap").raw_messages())


def test_an_empty_part_does_not_spoil_the_others(tmp_path: Path) -> None:
    (tmp_path / "log.mcap").write_bytes(b"")
    write(tmp_path / "log-2.mcap", [gait(0), gait(1)])
    reader = LogReader(tmp_path / "log.mcap")
    assert len(list(reader.raw_messages())) == 2
    assert reader.truncated
