"""Sizes, times, the status line and the warning of a full disk."""

import io
import logging
import shutil
from collections import namedtuple
from pathlib import Path

import pytest

from services.logger.errors import LoggerError
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink
from services.logger.record.status import Status
from services.logger.record.units import format_duration, format_size, parse_duration, parse_size
from tests.services.logger.support import START, gait, mark

Usage = namedtuple("Usage", "total used free")


@pytest.mark.parametrize(
    ("text", "size"),
    [("2GB", 2 * 10**9), ("500 MiB", 500 * 2**20), ("1.5kb", 1500), ("4096", 4096), ("7 b", 7)],
)
def test_sizes(text: str, size: int) -> None:
    assert parse_size(text) == size


@pytest.mark.parametrize(
    ("text", "seconds"), [("10min", 600), ("90s", 90), ("1.5h", 5400), ("3", 3)]
)
def test_times(text: str, seconds: float) -> None:
    assert parse_duration(text) == seconds


@pytest.mark.parametrize("text", ["", "GB", "-2GB", "2 XB", "two", "1e3"])
def test_no_sizes_and_no_times(text: str) -> None:
    with pytest.raises(LoggerError, match="not a size"):
        parse_size(text)
    with pytest.raises(LoggerError, match="not a time"):
        parse_duration(text)


def test_formats() -> None:
    assert [format_size(x) for x in (999, 1500, 2.5e6, 3e9)] == [
        "999 B",
        "1.5 kB",
        "2.5 MB",
        "3.0 GB",
    ]
    assert [format_duration(x) for x in (5, 65, 3725)] == ["00:05", "01:05", "1:02:05"]


@pytest.fixture
def recorder(tmp_path: Path) -> Recorder:
    made = Recorder(McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig()), LoggerConfig())
    for sample in (*(gait(seq) for seq in range(100)), mark(0, 7, START, 1, "door")):
        made.intake.offer(sample)
    made._drain()
    return made


def test_the_line_tells_rates_size_losses_disk_and_episode(recorder: Recorder) -> None:
    stream = io.StringIO()
    status = Status(recorder, 0, stream, live=True)
    recorder.lost = 3
    status.update(status._began + 2.0)
    status.update(status._began + 2.1)  # too early
    status.end()
    (line,) = stream.getvalue().splitlines()[1:]
    for text in ("00:02", "50 msg/s", "B/s", "lost 3", "dropped 0", "free ", "episode 7 door"):
        assert text in line


def test_a_low_disk_is_warned_of_once_a_minute(
    recorder: Recorder, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(shutil, "disk_usage", lambda _: Usage(10**9, 10**9 - 5000, 5000))
    caplog.set_level(logging.WARNING)
    stream = io.StringIO()
    status = Status(recorder, 10_000, stream, live=False)
    for seconds in (1.0, 2.0, 30.0, 60.5, 61.5):
        status.update(status._began + seconds)
    assert len(caplog.records) == 2
    assert "nearly full: 5.0 kB free" in caplog.records[0].getMessage()
    assert "at this rate for 00:00" in caplog.records[0].getMessage()
    assert stream.getvalue() == ""
    Status(recorder, 1000, stream, live=False).update(1e9)
    assert len(caplog.records) == 2
