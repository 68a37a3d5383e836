"""Putting a new file in the place of an old one, so that at no moment there is none."""

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
    """Keep a recorder's, and any other repair's, hands off ``path``."""
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
    """Whether a recorder or a repair is at work on ``path`` at this moment."""
    try:
        with locked(path):
            return False
    except LoggerError:
        return True


@contextlib.contextmanager
def tidy(beside: Path, target: Path) -> Iterator[None]:
    """Leave nothing half written behind, and say what to do about a disk that is full."""
    beside.unlink(missing_ok=True)
    try:
        yield
    except OSError as error:
        raise write_error(target, error) from error
    finally:
        beside.unlink(missing_ok=True)


def keep(path: Path) -> Path:
    """Give the broken file a second name, so that at no moment there is none."""
    names = (path.with_name(f"{path.name}.broken{'' if n == 1 else f'-{n}'}") for n in count(1))
    kept = next(name for name in names if not name.exists())
    try:
        os.link(path, kept)
    except OSError:  # a file system without links
        shutil.copyfile(path, kept)
    return kept


def put(beside: Path, target: Path) -> None:
    """Let ``beside`` take the name ``target``, for good."""
    with beside.open("rb") as stream:
        os.fsync(stream.fileno())
    beside.replace(target)
    directory = os.open(target.parent, os.O_RDONLY)
    try:
        os.fsync(directory)
    finally:
        os.close(directory)
