"""Writes and reads the data tables of lerobot's format, a row for each frame."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from lab.demonstrations.export import lerobot_layout as layout


class DataTables:
    """The files of the data tables; a new file is begun only between episodes.

    Attributes:
        file: number of the file that is being written.
    """

    def __init__(self, root: Path, schema: pa.Schema) -> None:
        self._root, self._schema = root, schema
        self._writer: Any = None
        self.file = -1

    def _path(self, file: int) -> Path:
        return self._root / layout.DATA_PATH.format(chunk_index=0, file_index=file)

    def begin_episode(self) -> None:
        """Begin the next episode, in a new file if the last one is large enough."""
        if self._writer is None or self._path(self.file).stat().st_size > layout.DATA_MB << 20:
            self.close()
            self.file += 1
            self._path(self.file).parent.mkdir(parents=True, exist_ok=True)
            self._writer = pq.ParquetWriter(self._path(self.file), self._schema)

    def add(self, columns: dict[str, Any]) -> None:
        """Append rows, given by column."""
        arrays = [_to_arrow(columns[field.name], field.type) for field in self._schema]
        self._writer.write_table(pa.Table.from_arrays(arrays, schema=self._schema))

    def close(self) -> None:
        """Finish the file."""
        if self._writer is not None:
            self._writer.close()
            self._writer = None

    def read(self, column: str) -> Any:
        """Read a column of all files, which must be closed, as a numpy array."""
        tables = [
            pq.read_table(self._path(file), columns=[column]) for file in range(self.file + 1)
        ]
        return np.concatenate([_to_numpy(table[column].combine_chunks()) for table in tables])


def _to_arrow(values: Any, kind: pa.DataType) -> pa.Array:
    if pa.types.is_fixed_size_list(kind):
        flat = pa.array(values.reshape(-1), kind.value_type)
        return pa.FixedSizeListArray.from_arrays(flat, kind.list_size)
    return pa.array(values, kind)


def _to_numpy(array: Any) -> Any:
    if pa.types.is_fixed_size_list(array.type):
        return array.flatten().to_numpy().reshape(-1, array.type.list_size)
    return array.to_numpy(zero_copy_only=False)
