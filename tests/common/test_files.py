"""Files of long runs: whole or not there, line by line, one writer or several that take turns."""

import fcntl
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from common.errors import ConfigError
from common.files import appending, exclusive_lock, whole_folder, write_whole
from tests.disk import fill


def append_line(path: Path, text: str) -> None:
    with appending(path) as append:
        append(text)


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


@pytest.mark.parametrize("size", [0, 1, 4095, 4096, 4097, 3 * 4096])
@pytest.mark.parametrize("before", ["", "one\n"])
def test_a_torn_line_of_any_length_is_taken_away(tmp_path: Path, before: str, size: int) -> None:
    path = tmp_path / "lines"
    path.write_text(before + "x" * size)
    append_line(path, "last")
    assert path.read_text() == before + "last\n"


def test_a_line_costs_the_same_however_long_the_file_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "lines"
    path.write_bytes(b"x" * 99 + b"\n")
    os.truncate(path, 8 * 2**30)  # holes cost no disk
    with path.open("ab") as file:
        file.write(b"\n")
    real, read = Path.open, list[int]()

    class Counted:
        def __init__(self, file: Any) -> None:
            self._file = file

        def __getattr__(self, name: str) -> Any:
            return getattr(self._file, name)

        def __enter__(self) -> "Counted":
            return self

        def __exit__(self, *_: object) -> None:
            self._file.close()

        def read(self, size: int = -1) -> bytes:
            data: bytes = self._file.read(size)
            read.append(len(data))
            return data

    monkeypatch.setattr(Path, "open", lambda path, mode: Counted(real(path, mode)))
    append_line(path, "last")
    assert sum(read) <= 4096


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
        exclusive_lock(lock, ConfigError),
        pytest.raises(ConfigError, match="written by another process"),
        exclusive_lock(lock, ConfigError),
    ):
        pass
    with exclusive_lock(lock, ConfigError):
        assert os.path.exists(lock)


def test_a_file_system_without_locks_is_not_another_process(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def none(_file: object, _how: int) -> None:
        raise OSError(37, "No locks available")

    monkeypatch.setattr("common.files.fcntl.flock", none)
    with (
        pytest.raises(OSError, match="No locks available"),
        exclusive_lock(tmp_path / "lock", ConfigError),
    ):
        pass


def test_a_folder_is_there_with_all_its_files_or_not_at_all(tmp_path: Path) -> None:
    def write(last: bool) -> None:
        with whole_folder(tmp_path / "made") as folder:
            write_whole(folder / "one", b"1")
            assert not (tmp_path / "made").exists()
            if not last:
                raise KeyboardInterrupt
            write_whole(folder / "two", b"2")

    # As a killed process leaves it.
    (tmp_path / "made.part").mkdir()
    (tmp_path / "made.part" / "old").touch()
    with pytest.raises(KeyboardInterrupt):
        write(last=False)
    assert not list(tmp_path.iterdir())
    write(last=True)
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
    assert sorted(path.name for path in (tmp_path / "made").iterdir()) == ["one", "two"]
    with pytest.raises(FileExistsError, match="made is there already"):
        write(last=True)
