"""Reads and writes an episode as one HDF5 file: arrays at 20 Hz, JPEG pictures, and metadata.

Any language reads HDF5, a training loop can read ten frames out of the middle, and names, units
and frames sit beside the numbers. Pictures are JPEG files one after another in
``images/<camera>/data``; picture i is ``data[offset[i]:offset[i + 1]]``. Nothing in a file depends
on when or where it was written: the same seed gives the same bytes.

Reading needs h5py, numpy and pydantic only; decoding a picture needs OpenCV besides.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from common.episodes.columns import BY_PATH, CAMERAS, COLUMNS, Rows
from common.episodes.errors import EpisodeError
from common.errors import explain

FORMAT = "trill-episode"
SCHEMA_VERSION = 2
RATE = 20
"""Frames per second."""
PERIOD_NS = 1_000_000_000 // RATE
"""Time from one frame to the next [ns]."""
Image = NDArray[np.uint8]
Operator = Literal["synthetic", "person", "policy"]
"""Who operates the robot: a program that imitates a person, a person, or a learned policy."""


class EpisodeMeta(BaseModel):
    """Describes an episode beside its arrays; the file keeps it as the attribute ``meta``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA_VERSION
    operator: Operator = Field(description="who operated the robot")
    task: str = Field(description="name of the task, for instance door/unlock")
    goal: str = Field(description="the task's goal as a sentence")
    seed: int = Field(ge=0, description="seed of the trial; identifies it within its data set")
    verdict: str = Field(description="success, partial, failure, or error")
    reason: str = Field(description="the judge's reason")
    completion_time: float = Field(ge=0.0, description="robot time until the verdict [s]")
    verdict_frame: int = Field(ge=-1, description="first frame after the verdict; -1: none")
    frames: int = Field(ge=0, description="number of frames, at 20 Hz")
    rate: int = RATE
    frame_tolerance: float = Field(
        default=0.001, ge=0.0, description="a frame may be off its place in time by this [s]"
    )
    picture_size: tuple[int, int] | None = Field(
        description="width and height of the pictures [pixels]; null: there are none"
    )
    stages: tuple[str, ...] = Field(description="stages of the task that were completed")
    gave_up: str = Field(description="why the operator ended early; empty: it did not")
    origin: dict[str, JsonValue] = Field(
        description="the settings under which the episode came about, all but the seed"
    )
    versions: dict[str, str] = Field(description="versions of Python and packages")
    source: str = Field(default="", description="digest of the code that made it; empty: unknown")

    @property
    def success(self) -> bool:
        """Whether the task was completed without undesired contacts."""
        return self.verdict == "success"


def to_bytes(meta: EpisodeMeta, rows: Rows, pictures: Mapping[str, Sequence[bytes]]) -> bytes:
    """Return the content of an episode's file.

    Args:
        meta: metadata of the episode.
        rows: its frames.
        pictures: JPEG files by camera, one a frame; empty: the episode has none.
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
        for camera, files in pictures.items():
            _write_pictures(file.create_group(f"images/{camera}"), files)
    return buffer.getvalue()


def _write_pictures(group: Any, files: Sequence[bytes]) -> None:
    ends = np.cumsum([0, *(len(file) for file in files)], dtype=np.int64)
    group.create_dataset("data", data=np.frombuffer(b"".join(files), dtype=np.uint8))
    group.create_dataset("offset", data=ends)
    group.attrs["doc"] = "JPEG files; picture i is data[offset[i]:offset[i + 1]]; row 0 on top"


class Episode:
    """Gives access to an open episode file; arrays are read when they are asked for.

    Attributes:
        meta: metadata of the episode.
    """

    def __init__(self, file: Any, meta: EpisodeMeta) -> None:
        self._file, self.meta = file, meta

    def array(self, path: str, frames: slice = slice(None)) -> NDArray[Any]:
        """Return a column of :data:`~common.episodes.columns.COLUMNS`; its first axis is frames.

        Raises:
            EpisodeError: there is no such column.
        """
        if path not in BY_PATH:
            raise EpisodeError(f"unknown array {path!r}: expected one of {', '.join(BY_PATH)}")
        return np.asarray(self._file[path][frames])

    @property
    def has_pictures(self) -> bool:
        """Whether the file holds pictures."""
        return "images" in self._file

    def jpeg(self, camera: str, frame: int) -> bytes:
        """Return one picture as a JPEG file.

        Raises:
            EpisodeError: there are no pictures, or no such frame.
        """
        if not self.has_pictures or camera not in CAMERAS or not 0 <= frame < self.meta.frames:
            raise EpisodeError(
                f"no picture of the {camera} camera in frame {frame}: the episode has "
                f"{self.meta.frames} frames {'with' if self.has_pictures else 'without'} pictures"
            )
        group = self._file[f"images/{camera}"]
        begin, end = group["offset"][frame : frame + 2]
        return bytes(group["data"][begin:end].tobytes())

    def picture(self, camera: str, frame: int) -> Image:
        """Decode one picture (height, width, 3) RGB; this needs OpenCV.

        Raises:
            EpisodeError: there are no pictures or no such frame, or the picture is damaged.
        """
        # Everything else in this file must be readable without OpenCV.
        import cv2

        file = np.frombuffer(self.jpeg(camera, frame), dtype=np.uint8)
        try:
            picture = cv2.cvtColor(cv2.imdecode(file, cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
        except cv2.error as error:
            raise EpisodeError(
                f"the picture of the {camera} camera in frame {frame} is damaged: "
                f"{str(error).partition(chr(10))[0]}"
            ) from error
        return np.asarray(picture, dtype=np.uint8)


@contextmanager
def open_episode(path: Path) -> Iterator[Episode]:
    """Open an episode's file for reading.

    Raises:
        EpisodeError: it is no episode file, or one of another version.
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
    """Read the JSON text of an episode's metadata; ``path`` is for the message.

    Raises:
        EpisodeError: the text does not fit :class:`EpisodeMeta`.
    """
    try:
        return EpisodeMeta.model_validate_json(text)
    except ValidationError as error:
        raise EpisodeError(f"{path}: the metadata is wrong: {explain(error)}") from error
