"""Locks a log against other recorders and repairs, and replaces it in one step."""

import contextlib
import fcntl
import os
import shutil
from collections.abc import Iterator
from itertools import count
from pathlib import Path

from services.logger.errors import LoggerError
from services.logger.log_format import write_error


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


@contextlib.contextmanager
def temporary_for(target: Path) -> Iterator[Path]:
    """Yield the path of a temporary file beside ``target``; remove what is left of it.

    Raises:
        LoggerError: writing failed, for instance because the disk is full.
    """
    temporary = target.with_name(f".{target.name}.repairing")
    temporary.unlink(missing_ok=True)
    try:
        yield temporary
    except OSError as error:
        raise write_error(target, error) from error
    finally:
        temporary.unlink(missing_ok=True)


def keep_original(path: Path) -> Path:
    """Give the file a second name, ``<name>.broken``, and return that."""
    names = (path.with_name(f"{path.name}.broken{'' if n == 1 else f'-{n}'}") for n in count(1))
    kept = next(name for name in names if not name.exists())
    try:
        os.link(path, kept)
    except OSError:  # a file system without links
        shutil.copyfile(path, kept)
    return kept


def replace_durably(temporary: Path, target: Path) -> None:
    """Rename ``temporary`` to ``target`` once it is on the disk."""
    with temporary.open("rb") as stream:
        os.fsync(stream.fileno())
    temporary.replace(target)
    directory = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
