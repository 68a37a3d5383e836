"""Folders of results: written by one process at a time, with the disk's errors in plain words."""

import errno
import json
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel, ValidationError

from common.errors import TrillError, explain
from common.files import exclusive_lock, write_whole

M = TypeVar("M", bound=BaseModel)

_ADVICE = {
    errno.ENOSPC: "; make room and give the same command again, what is done is kept",
    errno.EDQUOT: "; your quota is used up: make room and give the same command again",
    errno.EROFS: "; choose another --out",
    errno.EACCES: "; expected a directory you may write to: choose another --out",
    errno.ENOTDIR: "; expected a directory, got a file: choose another --out",
    errno.EEXIST: "; expected a directory, got a file: choose another --out",
    errno.ENAMETOOLONG: "; choose another --out",
}


@contextmanager
def disk_errors(path: Path, kind: type[TrillError], action: str = "write") -> Iterator[None]:
    """Turn errors of the operating system into ``kind``, with advice.

    Args:
        path: the file or folder that is used.
        kind: type of the exception that is raised instead.
        action: verb for the message, ``write`` or ``read``.
    """
    try:
        yield
    except OSError as error:
        advice = _ADVICE.get(error.errno or 0, "; what is done is kept")
        raise kind(f"cannot {action} {path}: {error.strerror or error}{advice}") from error


@contextmanager
def locked_folder(root: Path, kind: type[TrillError]) -> Iterator[None]:
    """Make a folder if necessary, and be the only process that writes to it.

    Raises:
        TrillError: of type ``kind``: another process writes to it, or it cannot be written.
    """
    with ExitStack() as stack:
        with disk_errors(root, kind):
            root.mkdir(parents=True, exist_ok=True)
            stack.enter_context(exclusive_lock(root / ".lock", kind))
        yield


def write_file(path: Path, content: bytes, kind: type[TrillError]) -> None:
    """Write a file whole or not at all.

    Raises:
        TrillError: of type ``kind``: it cannot be written.
    """
    with disk_errors(path, kind):
        write_whole(path, content)


def write_model(path: Path, model: BaseModel, kind: type[TrillError]) -> None:
    """Write a model as a JSON file that people can read.

    Raises:
        TrillError: of type ``kind``: it cannot be written.
    """
    text = json.dumps(model.model_dump(mode="json"), indent=1, ensure_ascii=False) + "\n"
    write_file(path, text.encode(), kind)


def read_model(path: Path, model: type[M], kind: type[TrillError]) -> M | None:
    """Read a file of :func:`write_model`; None: there is no file.

    Raises:
        TrillError: of type ``kind``: it cannot be read, or does not fit ``model``.
    """
    try:
        return model.model_validate_json(path.read_bytes())
    except FileNotFoundError:
        return None
    except OSError as error:
        raise kind(f"cannot read {path}: {error.strerror}") from error
    except ValidationError as error:
        raise kind(f"{path}: {explain(error)}") from error
