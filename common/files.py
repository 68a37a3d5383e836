"""Write files of long runs so that a kill damages nothing: whole, or line by line."""

import fcntl
import os
import shutil
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import BinaryIO

from common.errors import TrillError

PART = ".part"
"""Ending of a file that is being written."""
_BLOCK = 4096
"""Bytes read at once to find the last line."""


@contextmanager
def whole_file(path: Path) -> Iterator[Path]:
    """Yield a temporary path beside ``path``, which replaces it when the block has ended well.

    The file is there whole or not at all, whenever the process is killed; the temporary one is
    removed if the block fails.

    Raises:
        OSError: it cannot be written.
    """
    temporary = path.with_name(path.name + PART)
    try:
        yield temporary
        _synchronise(temporary)
        temporary.replace(path)
        _synchronise(path.parent)
    finally:
        # A useless remnant must not keep a full disk full.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write ``content`` as a :func:`whole_file`.

    Raises:
        OSError: it cannot be written.
    """
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


@contextmanager
def whole_folder(path: Path) -> Iterator[Path]:
    """Yield a new folder beside ``path``, which becomes ``path`` when the block has ended well.

    The folder is there with all its files or not at all; the files have to be written with
    :func:`write_whole`. The temporary folder is removed if the block fails.

    Raises:
        FileExistsError: there is a file or folder at ``path`` already.
        OSError: it cannot be written.
    """
    if path.exists():
        raise FileExistsError(f"{path} is there already")
    temporary = path.with_name(path.name + PART)
    # A killed process may have left one.
    shutil.rmtree(temporary, ignore_errors=True)
    temporary.mkdir(parents=True)
    try:
        yield temporary
        temporary.rename(path)
        _synchronise(path.parent)
    finally:
        shutil.rmtree(temporary, ignore_errors=True)


def write_folder(path: Path, contents: Mapping[str, bytes]) -> None:
    """Write a new folder with files by name, as :func:`whole_folder` does.

    Raises:
        FileExistsError: there is a file or folder at ``path`` already.
        OSError: it cannot be written.
    """
    with whole_folder(path) as temporary:
        for name, content in contents.items():
            write_whole(temporary / name, content)


def _synchronise(path: Path) -> None:
    """Wait until a file, or the names in a directory, are on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


@contextmanager
def appending(path: Path) -> Iterator[Callable[[str], None]]:
    """Yield a function that appends a line; other processes that would append wait meanwhile.

    A torn last line is removed first. A line is on the disk when the function returns.

    Raises:
        OSError: the file cannot be written.
    """
    with path.open("a+b") as file:
        # Without the lock, a line that another process is writing would be taken for torn.
        fcntl.flock(file, fcntl.LOCK_EX)
        whole = _end_of_last_line(file)
        if whole < file.seek(0, os.SEEK_END):
            file.truncate(whole)

        def append(text: str) -> None:
            file.write(text.encode() + b"\n")
            file.flush()
            os.fsync(file.fileno())

        yield append


def _end_of_last_line(file: BinaryIO) -> int:
    """Return the offset after the last newline, reading backwards from the end."""
    end = file.seek(0, os.SEEK_END)
    while end > 0:
        start = max(0, end - _BLOCK)
        file.seek(start)
        newline = file.read(end - start).rfind(b"\n")
        if newline >= 0:
            return start + newline + 1
        end = start
    return 0


@contextmanager
def exclusive_lock(lock: Path, refused: type[TrillError]) -> Iterator[None]:
    """Be the only process that works in the directory of the file ``lock``.

    Raises:
        OSError: the file cannot be opened, or the file system does not support locks.
        TrillError: of the type ``refused``: another process holds the lock.
    """
    # The system releases the lock when the process ends, however it ends.
    with lock.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise refused(
                f"{lock.parent} is being written by another process; wait for it or choose "
                "another --out"
            ) from error
        yield
