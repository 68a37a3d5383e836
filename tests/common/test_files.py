"""Files of long runs: whole or not there, line by line, one writer or several that take turns."""

import fcntl
import os
import threading
from pathlib import Path

import pytest

from common.errors import ConfigError
from common.files import alone, append_line, write_whole
from tests.disk import fill


def test_a_file_that_cannot_be_finished_leaves_the_one_before(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "table.csv"
    write_whole(path, b"before")
    fill(monkeypatch)
    with pytest.raises(OSError, match="No space"):
        write_whole(path, b"after")
    assert path.read_bytes() == b"before"
    assert [p.name for p in tmp_path.iterdir()] == ["table.csv"]


def test_a_torn_last_line_is_taken_away(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    append_line(path, "one")
    with path.open("ab") as file:
        file.write(b"tw")
    append_line(path, "three")
    assert path.read_text() == "one\nthree\n"


def test_a_line_that_another_one_is_writing_is_not_torn(tmp_path: Path) -> None:
    path = tmp_path / "lines"
    append_line(path, "one")
    with path.open("ab", buffering=0) as other:
        fcntl.flock(other, fcntl.LOCK_EX)
        other.write(b"tw")
        waiting = threading.Thread(target=append_line, args=(path, "three"))
        waiting.start()
        waiting.join(0.2)
        assert waiting.is_alive()
        other.write(b"o\n")
        fcntl.flock(other, fcntl.LOCK_UN)
    waiting.join(10.0)
    assert path.read_text() == "one\ntwo\nthree\n"


def test_one_at_a_time(tmp_path: Path) -> None:
    lock = tmp_path / ".lock"
    with (
        alone(lock, ConfigError),
        pytest.raises(ConfigError, match="written by another process"),
        alone(lock, ConfigError),
    ):
        pass
    with alone(lock, ConfigError):
        assert os.path.exists(lock)


def test_a_file_system_without_locks_is_not_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(_file: object, _how: int) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("common.files.fcntl.flock", none)
    with pytest.raises(OSError, match="No locks available"), alone(tmp_path / "lock", ConfigError):
        pass
