"""An episode as one HDF5 file: arrays of 20 Hz, JPEG pictures, and what it all means.

HDF5, since any language reads it, a training loop can read ten frames out of the middle, and names,
units and frames sit beside the numbers. Pictures are JPEG files one after another in
``images/<eye>/data``; picture i is ``data[offset[i]:offset[i + 1]]``. Nothing in a file depends on
when or where it was written: same seed, same bytes.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from common.episodes.columns import BY_PATH, COLUMNS, EYES, Rows
from common.episodes.errors import EpisodeError
from common.errors import explain
from lab.demonstrations.collect.recipe import EpisodeConfig

FORMAT = "trill-episode"
SCHEMA_VERSION = 1
RATE = 20
"""Frames per second."""
Image = NDArray[np.uint8]


class EpisodeMeta(BaseModel):
    """What is known of an episode beside its arrays; kept in the file as the attribute ``meta``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA_VERSION
    task: str
    seed: int = Field(ge=0)
    synthetic: bool = Field(default=True, description="the operator is no person")
    verdict: str = Field(description="success, partial, failure, or error")
    reason: str
    completion_time: float = Field(ge=0.0, description="robot time until the verdict [s]")
    verdict_frame: int = Field(ge=-1, description="first frame after the verdict; -1: none")
    frames: int = Field(ge=0, description="at 20 Hz")
    rate: int = RATE
    stages: tuple[str, ...] = Field(description="of the task that were done")
    gave_up: str = Field(description="why the operator ended early; empty: it did not")
    recipe: EpisodeConfig = Field(description="all that the episode depends on, but for the seed")
    versions: dict[str, str] = Field(description="of Python and packages")
    source: str = Field(default="", description="digest of the code that made it; empty: unknown")

    @property
    def success(self) -> bool:
        """Whether the task was done as it should be."""
        return self.verdict == "success"


def to_bytes(meta: EpisodeMeta, rows: Rows, pictures: Mapping[str, Sequence[bytes]]) -> bytes:
    """The file's content.

    Args:
        meta: of the episode.
        rows: its frames.
        pictures: JPEG files by eye, one a frame; empty: none.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["schema_version"] = SCHEMA_VERSION
        file.attrs["meta"] = meta.model_dump_json()
        for column in COLUMNS:
            values = np.array(rows.rows[column.path], dtype=column.dtype)
            shape = column.shape if not column.varies else values.shape[1:]
            values = values.reshape((len(rows), *shape))
            data = file.create_dataset(column.path, data=values)
            data.attrs["doc"], data.attrs["unit"] = column.doc, column.unit
            if column.frame:
                data.attrs["frame"] = column.frame
            if column.names:
                data.attrs["names"] = list(column.names)
        for eye, files in pictures.items():
            _write_pictures(file.create_group(f"images/{eye}"), files)
    return buffer.getvalue()


def _write_pictures(group: Any, files: Sequence[bytes]) -> None:
    ends = np.cumsum([0, *(len(file) for file in files)], dtype=np.int64)
    group.create_dataset("data", data=np.frombuffer(b"".join(files), dtype=np.uint8))
    group.create_dataset("offset", data=ends)
    group.attrs["doc"] = "JPEG files; picture i is data[offset[i]:offset[i + 1]]; row 0 on top"


class Episode:
    """An open episode; arrays are read when asked for.

    Attributes:
        meta: what is known of it.
    """

    def __init__(self, file: Any, meta: EpisodeMeta) -> None:
        self._file, self.meta = file, meta

    def array(self, path: str, frames: slice = slice(None)) -> NDArray[Any]:
        """A column of :data:`~common.episodes.columns.COLUMNS`, first axis the frames.

        Raises:
            EpisodeError: there is no such column.
        """
        if path not in BY_PATH:
            raise EpisodeError(f"unknown array {path!r}: expected one of {', '.join(BY_PATH)}")
        return np.asarray(self._file[path][frames])

    @property
    def has_pictures(self) -> bool:
        """Whether there are pictures."""
        return "images" in self._file

    def jpeg(self, eye: str, frame: int) -> bytes:
        """One picture as a JPEG file.

        Raises:
            EpisodeError: there are no pictures, or no such frame.
        """
        if not self.has_pictures or eye not in EYES or not 0 <= frame < self.meta.frames:
            raise EpisodeError(
                f"no picture of the {eye} eye in frame {frame}: the episode has "
                f"{self.meta.frames} frames {'with' if self.has_pictures else 'without'} pictures"
            )
        group = self._file[f"images/{eye}"]
        begin, end = group["offset"][frame : frame + 2]
        return bytes(group["data"][begin:end].tobytes())

    def picture(self, eye: str, frame: int) -> Image:
        """One picture (height, width, 3) RGB."""
        file = np.frombuffer(self.jpeg(eye, frame), dtype=np.uint8)
        picture = cv2.cvtColor(cv2.imdecode(file, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        return np.asarray(picture, dtype=np.uint8)


@contextmanager
def open_episode(path: Path) -> Iterator[Episode]:
    """Open an episode's file.

    Raises:
        EpisodeError: it is none, or of another version.
    """
    try:
        with h5py.File(path, "r") as file:
            yield Episode(file, _meta_of(path, file))
    except OSError as error:
        raise EpisodeError(f"cannot read {path} as an episode: {error}") from error


def _meta_of(path: Path, file: Any) -> EpisodeMeta:
    kind, number = file.attrs.get("format"), file.attrs.get("schema_version")
    if kind != FORMAT or number != SCHEMA_VERSION:
        raise EpisodeError(
            f"{path}: expected an HDF5 file of format {FORMAT!r} version {SCHEMA_VERSION}, got "
            f"{kind!r} version {number}"
        )
    return parse_meta(path, str(file.attrs["meta"]))


def parse_meta(path: Path, text: str) -> EpisodeMeta:
    """Check the JSON of an episode's description.

    Raises:
        EpisodeError: it is not understood.
    """
    try:
        return EpisodeMeta.model_validate_json(text)
    except ValidationError as error:
        raise EpisodeError(f"{path}: the description is wrong: {explain(error)}") from error
