"""Exceptions about episodes; and what an error of h5py means for the file."""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from common.errors import TrillError


class EpisodeError(TrillError):
    """Root: an episode file or a data set cannot be read, or is not what it should be."""


class EpisodeAccessError(EpisodeError):
    """A file cannot be reached now: it is locked, forbidden or gone. Its content may be whole."""


class EpisodeDamagedError(EpisodeError):
    """The bytes of a file are no episode, or not those that were written."""


_WRONG_BYTES = (KeyError, MemoryError, OSError, RuntimeError, TypeError, ValueError)
"""What h5py raises where bytes of a file are wrong; an OSError only without an ``errno``."""
_BUSY = "another program has it open for writing; close it there and try again"
_ADVICE = {
    errno.EAGAIN: _BUSY,
    errno.ENOLCK: "its file system knows no locks: set HDF5_USE_FILE_LOCKING=FALSE",
    errno.ENOTSUP: "its file system knows no locks: set HDF5_USE_FILE_LOCKING=FALSE",
    errno.EACCES: "you may not read it: ask its owner",
    errno.EPERM: "you may not read it: ask its owner",
    errno.ENOENT: "it is gone",
    errno.EMFILE: "this process has too many files open: raise the limit with ulimit -n",
    errno.ENFILE: "this machine has too many files open",
    errno.EIO: "its disk or network does not answer; look at the disk before you trust it",
    errno.ESTALE: "its file server has lost it; mount it again",
}


@contextmanager
def reading(path: Path) -> Iterator[None]:
    """Turn errors of reading the episode file at ``path`` into errors of this project.

    The operating system gives its errors a number; HDF5 gives wrong bytes none. Only the latter
    are damage.

    Raises:
        EpisodeAccessError: the file cannot be reached now.
        EpisodeDamagedError: its bytes are wrong.
    """
    try:
        yield
    except _WRONG_BYTES as error:
        number = getattr(error, "errno", None)
        if number is None:
            raise EpisodeDamagedError(
                f"cannot read {path} as an episode, it is damaged or of another kind: {error}"
            ) from error
        reason = _ADVICE.get(number, str(error).partition("\n")[0])
        raise EpisodeAccessError(f"cannot open {path} now: {reason}") from error
