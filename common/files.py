"""Files of long runs that survive a kill: written whole, line by line, by one process at a time."""

import fcntl
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from common.errors import TrillError

PART = ".part"
"""Ending of a file that is being written."""


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
        # A full disk should not stay full because of a file that is of no use.
        with suppress(OSError):
            temporary.unlink(missing_ok=True)


def write_whole(path: Path, content: bytes) -> None:
    """Write ``content`` as a :func:`whole_file`.

    Raises:
        OSError: it cannot be written.
    """
    with whole_file(path) as temporary:
        temporary.write_bytes(content)


def _synchronise(path: Path) -> None:
    """Wait until a file, or the names in a directory, are on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def append_line(path: Path, text: str) -> None:
    """Append a line; on the disk when this returns. A torn last line is taken away before.

    Several processes may do so at once.

    Raises:
        OSError: it cannot be written.
    """
    with path.open("a+b") as file:
        # Without it a line that another one is writing would be taken for torn.
        fcntl.flock(file, fcntl.LOCK_EX)
        file.seek(0)
        content = file.read()
        whole = content.rfind(b"\n") + 1
        if whole < len(content):
            file.truncate(whole)
        file.write(text.encode() + b"\n")
        file.flush()
        os.fsync(file.fileno())


@contextmanager
def alone(lock: Path, refused: type[TrillError]) -> Iterator[None]:
    """Be the only process that works in the directory of the file ``lock``.

    Raises:
        OSError: the file cannot be opened, or the file system knows no locks.
        TrillError: of the type ``refused``: another process is at it.
    """
    # The system lets go of the lock when the process ends, however it ends.
    with lock.open("w") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise refused(
                f"{lock.parent} is being written by another process; wait for it or choose "
                "another --out"
            ) from error
        yield
