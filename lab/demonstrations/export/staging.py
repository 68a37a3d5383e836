"""Writes a file or directory whole or not at all: beside its place, and moved there at the end."""

import fcntl
import os
import shutil
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from lab.errors import DatasetError

_SUFFIX = ".part"
_OLD = ".old"


@contextmanager
def staged(out: Path, *, force: bool, ours: Callable[[Path], bool]) -> Iterator[Path]:
    """Yield a path to write to; it becomes ``out`` at the end, or is removed after an error.

    Args:
        out: file or directory to write.
        force: whether to replace an earlier result.
        ours: whether something is an earlier result; nothing else is replaced.

    Raises:
        DatasetError: ``out`` exists and may not be replaced, cannot be written, or is being made
            by another process.
    """
    # A link is followed; and the directory . has no name to put something beside.
    out = out.resolve()
    try:
        check_free(out, force=force, ours=ours)
        folder = out.with_name(f".{out.name}{_SUFFIX}")
        folder.mkdir(parents=True, exist_ok=True)
        handle = os.open(folder, os.O_RDONLY)
    except OSError as error:
        raise DatasetError(f"cannot write {out}: {error}; choose another --out") from error
    try:
        _lock(handle, out)
        old = folder / f"{out.name}{_OLD}"
        try:
            if old.exists() and not out.exists():
                old.rename(out)  # a run was killed while it replaced it
            check_free(out, force=force, ours=ours)
            for left in folder.iterdir():
                _remove(left)
            yield folder / out.name
            check_free(out, force=force, ours=ours)
            _move(folder / out.name, out, old)
        except (OSError, RuntimeError) as error:
            # Usually the disk is full; h5py raises both kinds then.
            reason = str(error).partition("\n")[0]
            raise DatasetError(
                f"{out} cannot be written: {reason}; nothing is left of it. Is the disk full?"
            ) from error
        finally:
            shutil.rmtree(folder, ignore_errors=True)
    finally:
        # This releases the lock; the end of the process would, too.
        os.close(handle)


def check_free(out: Path, *, force: bool, ours: Callable[[Path], bool]) -> None:
    """Check that ``out`` does not exist or may be replaced.

    Raises:
        DatasetError: it may not be replaced.
    """
    if not out.exists():
        return
    if not ours(out):
        raise DatasetError(
            f"{out} exists and is not an export of this format, so it is not replaced; choose "
            "another --out"
        )
    if not force:
        raise DatasetError(f"{out} exists; choose another --out, or replace it with --force")


def _lock(handle: int, out: Path) -> None:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError as error:
        raise DatasetError(
            f"{out} is being made by another process; wait for it or choose another --out"
        ) from error
    except OSError as error:
        raise DatasetError(
            f"cannot lock a file beside {out}: {error.strerror}; choose another --out"
        ) from error


def _move(new: Path, out: Path, old: Path) -> None:
    try:
        if out.exists():
            out.rename(old)
        new.rename(out)
    except BaseException:
        # After Ctrl-C, too: the folder is removed, and the earlier result must not be in it.
        if old.exists() and not out.exists():
            old.rename(out)
        raise


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
