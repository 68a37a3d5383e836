"""Locks a log against other recorders and repairs, and keeps the original of a repaired one."""

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from services.logger.errors import LoggerError


@contextlib.contextmanager
def locked(path: Path) -> Iterator[None]:
    """Hold the lock of ``path``, which a recorder or another repair would hold.

    Raises:
        LoggerError: the file cannot be opened, or another process holds its lock.
    """
    try:
        stream = path.open("rb")
    except OSError as error:
        raise LoggerError(f"cannot open the log {path}: {error.strerror}") from error
    with stream:
        try:
            fcntl.flock(stream, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise LoggerError(
                f"{path} is still being recorded, or repaired by another; stop that first"
            ) from error
        except OSError:  # a file system without locks
            pass
        yield


def is_locked(path: Path) -> bool:
    """Return whether a recorder or a repair holds the lock of ``path``."""
    try:
        with locked(path):
            return False
    except LoggerError:
        return True


def keep_original(path: Path) -> Path:
    """Give the file a second name, ``<name>.broken``, and return that."""
    names = (path.with_name(f"{path.name}.broken{'' if n == 1 else f'-{n}'}") for n in count(1))
    kept = next(name for name in names if not name.exists())
    try:
        os.link(path, kept)
    except OSError:  # a file system without links
        shutil.copyfile(path, kept)
    return kept
