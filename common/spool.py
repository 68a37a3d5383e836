"""Keep a table of numbers that grows without bound: most of it in a temporary file."""

import tempfile
from array import array
from collections.abc import Iterable, Iterator
from typing import IO, Literal

import numpy as np

from common.errors import TrillError
from common.order_statistics import Numbers

BLOCK = 16384
"""Rows written to the file at once; a shorter table has no file."""


class Spool:
    """Rows of numbers, which are read back by columns, piece by piece.

    The file is in the directory for temporary files and gone with the object.
    """

    def __init__(self, columns: int, kind: Literal["q", "d"]) -> None:
        """Start without rows of so many ``columns``: int64 (``q``) or float64 (``d``)."""
        self._columns = columns
        self._kind: Literal["q", "d"] = kind
        self._newest: array[int] | array[float] = array(kind)
        self._file: IO[bytes] | None = None
        self._blocks = 0

    def __len__(self) -> int:
        return self._blocks * BLOCK + len(self._newest) // self._columns

    def extend(self, numbers: Iterable[float]) -> None:
        """Append the numbers of a row, or of several one after the other.

        Raises:
            TrillError: the temporary file cannot be written.
        """
        self._newest.extend(numbers)  # type: ignore[arg-type]
        self._write_blocks()

    def add(self, rows: Numbers) -> None:
        """Append the rows of a table (n, columns) of the spool's kind.

        Raises:
            TrillError: the temporary file cannot be written.
        """
        self._newest.frombytes(rows.tobytes())
        self._write_blocks()

    def parts(self, *columns: int) -> Iterator[tuple[Numbers, ...]]:
        """Yield these columns piece by piece, each piece as new arrays of one length.

        Raises:
            TrillError: the temporary file cannot be read.
        """
        for number in range(self._blocks):
            yield tuple(self._stored(number, column) for column in columns)
        yield tuple(np.array(self._newest[one :: self._columns], self._kind) for one in columns)

    def _stored(self, number: int, column: int) -> Numbers:
        """Read a column of a block."""
        part = np.empty(BLOCK, self._kind)
        assert self._file is not None
        try:
            self._file.seek((number * self._columns + column) * BLOCK * part.itemsize)
            self._file.readinto(part)  # type: ignore[attr-defined]
        except OSError as error:
            raise spool_failure(error) from error
        return part

    def _write_blocks(self) -> None:
        """Write full blocks, column by column."""
        size = BLOCK * self._columns
        while len(self._newest) >= size:
            block = np.array(self._newest[:size]).reshape(BLOCK, self._columns)
            try:
                if self._file is None:
                    self._file = tempfile.TemporaryFile(prefix="trill-")  # noqa: SIM115
                self._file.seek(self._blocks * size * block.itemsize)
                self._file.write(block.T.tobytes())
            except OSError as error:
                raise spool_failure(error) from error
            self._blocks += 1
            del self._newest[:size]


def spool_failure(error: OSError) -> TrillError:
    """Say that the directory for temporary files cannot be used, and what to do."""
    return TrillError(
        f"cannot keep intermediate numbers in {tempfile.gettempdir()}: {error.strerror}; expected "
        "some free space there, or the name of another directory in TMPDIR"
    )
