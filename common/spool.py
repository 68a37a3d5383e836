"""Keep a table of numbers that grows without bound: most of it in a temporary file."""

import tempfile
from array import array
from collections.abc import Iterable
from typing import IO, Literal

import numpy as np
import numpy.typing as npt

from common.errors import TrillError

BLOCK = 16384
"""Rows written to the file at once; a shorter table has no file."""


class Spool:
    """Rows of numbers, of which one column at a time is read back.

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

    def add(self, rows: npt.NDArray[np.int64] | npt.NDArray[np.float64]) -> None:
        """Append the rows of a table (n, columns) of the spool's kind.

        Raises:
            TrillError: the temporary file cannot be written.
        """
        self._newest.frombytes(rows.tobytes())
        self._write_blocks()

    def column(self, index: int) -> npt.NDArray[np.int64] | npt.NDArray[np.float64]:
        """Return a column as a new array (rows,).

        Raises:
            TrillError: the temporary file cannot be read.
        """
        result = np.empty(len(self), self._kind)
        try:
            for number in range(self._blocks if self._file else 0):
                assert self._file is not None
                self._file.seek((number * self._columns + index) * BLOCK * result.itemsize)
                self._file.readinto(result[number * BLOCK : (number + 1) * BLOCK])  # type: ignore[attr-defined]
        except OSError as error:
            raise spool_failure(error) from error
        result[self._blocks * BLOCK :] = self._newest[index :: self._columns]
        return result

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
