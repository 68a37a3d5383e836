"""A result that is there whole or not at all: made beside its place, moved there at the end."""

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
    """Give a path to make ``out`` at; it becomes ``out`` if all goes well, else it is removed.

    Args:
        out: file or directory to make.
        force: replace what is there.
        ours: whether something is an earlier result; nothing else is ever replaced.

    Raises:
        DatasetError: ``out`` exists and may not be replaced, cannot be written, or is being made
            by another process.
    """
    # Where a link leads, it is to be; and . has no name to put something beside.
    out = out.resolve()
    try:
        check_free(out, force=force, ours=ours)
        workshop = out.with_name(f".{out.name}{_SUFFIX}")
        workshop.mkdir(parents=True, exist_ok=True)
        handle = os.open(workshop, os.O_RDONLY)
    except OSError as error:
        raise DatasetError(f"cannot write {out}: {error}; choose another --out") from error
    try:
        _lock(handle, out)
        old = workshop / f"{out.name}{_OLD}"
        try:
            if old.exists() and not out.exists():
                old.rename(out)  # a run was killed while it replaced it
            check_free(out, force=force, ours=ours)
            for left in workshop.iterdir():
                _remove(left)
            yield workshop / out.name
            check_free(out, force=force, ours=ours)
            _move(workshop / out.name, out, old)
        except (OSError, RuntimeError) as error:
            # A full disk, as a rule; h5py has both kinds for it.
            reason = str(error).partition("\n")[0]
            raise DatasetError(
                f"{out} cannot be written: {reason}; nothing is left of it. Is the disk full?"
            ) from error
        finally:
            shutil.rmtree(workshop, ignore_errors=True)
    finally:
        # The lock goes with it, or with the process, however that ends.
        os.close(handle)


def check_free(out: Path, *, force: bool, ours: Callable[[Path], bool]) -> None:
    """Refuse early to write where something is.

    Raises:
        DatasetError: it is.
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
        # Ctrl-C, too: the workshop goes, and it must not take the earlier result along.
        if old.exists() and not out.exists():
            old.rename(out)
        raise


def _remove(path: Path) -> None:
    if path.is_dir() and not path.is_symlink():
        shutil.rmtree(path)
    else:
        path.unlink()
