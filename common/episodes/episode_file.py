"""Reads and writes an episode as one HDF5 file: arrays at 20 Hz, JPEG pictures, and metadata.

Any language reads HDF5, a training loop can read ten frames out of the middle, and names, units
and frames sit beside the numbers. Pictures are JPEG files one after another in
``images/<camera>/data``; picture i is ``data[offset[i]:offset[i + 1]]``. The attributes of
``images/<camera>`` describe the camera. Nothing in a file depends on when it was written: the same
seed gives the same bytes on like processors, whose kind ``meta`` names.

Reading needs h5py, numpy and pydantic only; decoding a picture needs OpenCV besides.
"""

import io
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Literal

import h5py
import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, JsonValue, ValidationError

from common.episodes.columns import AXES, BY_PATH, CAMERAS, COLUMNS, RATE, Rows
from common.episodes.errors import EpisodeDamagedError, EpisodeError, reading
from common.errors import explain
from common.robot.cameras import PinholeCamera, stereo_pair
from common.robot.frames import BODY_FRAME, CAMERA_BASELINE

FORMAT = "trill-episode"
SCHEMA_VERSION = 2
PERIOD_NS = 1_000_000_000 // RATE
"""Time from one frame to the next [ns]."""
Image = NDArray[np.uint8]
Operator = Literal["synthetic", "person", "policy", "mixed"]
"""Who operates the robot: a program that imitates a person, a person, a learned policy, or a policy
in whose place another operator acts at times."""


class EpisodeMeta(BaseModel):
    """Describes an episode beside its arrays; the file keeps it as the attribute ``meta``."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    schema_version: int = SCHEMA_VERSION
    operator: Operator = Field(description="who operated the robot")
    task: str = Field(description="name of the task, for instance door/unlock")
    goal: str = Field(description="the task's goal as a sentence")
    seed: int = Field(
        ge=0,
        description="identifies it within its data set: seed of the trial, or number of a recorded "
        "episode",
    )
    verdict: str = Field(
        description="success, partial, failure, or error; unaided: a policy was to be helped and "
        "succeeded alone; discarded: whoever recorded it did not want it"
    )
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
    recording: dict[str, JsonValue] = Field(
        default={}, description="which part of which recording it is; empty: it was simulated"
    )
    versions: dict[str, str] = Field(description="versions of Python and packages")
    source: str = Field(default="", description="digest of the code that made it; empty: unknown")
    machine: str = Field(
        default="",
        description="kind of processor and numerical libraries; on others the last digits differ",
    )

    @property
    def success(self) -> bool:
        """Whether the task was completed without undesired contacts."""
        return self.verdict == "success"


def to_bytes(
    meta: EpisodeMeta,
    rows: Rows,
    pictures: Mapping[str, Sequence[bytes]],
    names: Mapping[str, Sequence[str]] | None = None,
) -> bytes:
    """Return the content of an episode's file.

    Args:
        meta: metadata of the episode.
        rows: its frames.
        pictures: JPEG files by camera, one a frame; empty: the episode has none.
        names: names along the second axis of the arrays whose width depends on the scene, by path.
    """
    buffer = io.BytesIO()
    with h5py.File(buffer, "w") as file:
        file.attrs["format"] = FORMAT
        file.attrs["schema_version"] = SCHEMA_VERSION
        file.attrs["meta"] = meta.model_dump_json()
        for column in COLUMNS:
            if column.optional and not rows.rows[column.path]:
                continue
            values = np.array(rows.rows[column.path], dtype=column.dtype)
            shape = column.shape if not column.varies else values.shape[1:]
            values = values.reshape((len(rows), *shape))
            data = file.create_dataset(column.path, data=values)
            data.attrs["doc"], data.attrs["unit"] = column.doc, column.unit
            if column.frame:
                data.attrs["frame"] = column.frame
            if column.frame == BODY_FRAME:
                data.attrs["axes"] = AXES
            if named := column.names or (names or {}).get(column.path):
                data.attrs["names"] = list(named)
        for camera, files in pictures.items():
            group = file.create_group(f"images/{camera}")
            _write_pictures(group, files)
            if meta.picture_size is not None:
                group.attrs.update(camera_attributes(stereo_pair()[camera], meta.picture_size))
    return buffer.getvalue()


def camera_attributes(
    camera: PinholeCamera, original: tuple[int, int], shown: tuple[int, int] | None = None
) -> dict[str, Any]:
    """Return what describes a camera of the stereo pair beside its pictures.

    Args:
        camera: the camera.
        original: width and height at which pictures were rendered [pixels].
        shown: width and height to which they were scaled; None: they were not.
    """
    width, height = shown or original
    return {
        "model": "pinhole, no distortion",
        "width": width,
        "height": height,
        "camera_matrix": camera.matrix(original, shown),
        "fovy_deg": camera.fovy_deg,
        "parent": camera.parent,
        "position_in_parent": np.array(camera.position),
        "quaternion_in_parent": np.array(camera.quaternion),
        "baseline": CAMERA_BASELINE,
        "camera_doc": (
            "camera_matrix [pixels] by OpenCV's convention: x right, y down, z into the picture; "
            "the centre of the first pixel is (0, 0). Position [m] and quaternion (w, x, y, z) of "
            f"these axes in the parent body {camera.parent}, which the joint neck_pitch turns. "
            "Baseline [m] between left and right"
        ),
    }


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

    def __init__(self, path: Path, file: Any, meta: EpisodeMeta) -> None:
        self._path, self._file, self.meta = path, file, meta

    def array(self, path: str, frames: slice = slice(None)) -> NDArray[Any]:
        """Return a column of :data:`~common.episodes.columns.COLUMNS`; its first axis is frames.

        Raises:
            EpisodeError: there is no such column, or it cannot be read.
        """
        if path not in BY_PATH:
            raise EpisodeError(f"unknown array {path!r}: expected one of {', '.join(BY_PATH)}")
        column = BY_PATH[path]
        if column.optional and path not in self._file:
            shape = (self.meta.frames, 0) if column.varies else (self.meta.frames, *column.shape)
            missing = np.nan if np.dtype(column.dtype).kind == "f" else 0
            return np.full(shape, missing, column.dtype)[frames]
        with reading(self._path):
            return np.asarray(self._file[path][frames])

    def holds(self, path: str) -> bool:
        """Return whether the file has a column; one that is optional may lack."""
        return path in self._file

    @property
    def has_pictures(self) -> bool:
        """Whether the file holds pictures."""
        return "images" in self._file

    def jpeg(self, camera: str, frame: int) -> bytes:
        """Return one picture as a JPEG file.

        Raises:
            EpisodeError: there are no pictures, or no such frame, or it cannot be read.
        """
        if not self.has_pictures or camera not in CAMERAS or not 0 <= frame < self.meta.frames:
            raise EpisodeError(
                f"no picture of the {camera} camera in frame {frame}: the episode has "
                f"{self.meta.frames} frames {'with' if self.has_pictures else 'without'} pictures"
            )
        with reading(self._path):
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
            raise EpisodeDamagedError(
                f"{self._path}: the picture of the {camera} camera in frame {frame} is damaged: "
                f"{str(error).partition(chr(10))[0]}"
            ) from error
        return np.asarray(picture, dtype=np.uint8)


@contextmanager
def open_episode(path: Path) -> Iterator[Episode]:
    """Open an episode's file for reading.

    Only errors of this file become an :class:`EpisodeError`; those of the caller's work do not.

    Raises:
        EpisodeError: it cannot be reached, is no episode file, or one of another version.
    """
    with ExitStack() as stack:
        with reading(path):
            file = stack.enter_context(h5py.File(path, "r"))
            meta = _meta_of(path, file)
        yield Episode(path, file, meta)


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
