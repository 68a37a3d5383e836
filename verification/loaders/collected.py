"""Read collected episodes from their files and compare them with what a loader returns."""

import json
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import h5py
import numpy as np

EYES = ("left", "right")
RATE = 20


class MismatchError(AssertionError):
    """A loader returned something else than was collected."""


@dataclass(frozen=True)
class CollectedEpisode:
    """A successful episode up to the judge's verdict.

    Attributes:
        file: the open HDF5 file.
        meta: the description of the episode.
        frames: number of frames before the verdict.
    """

    file: Any
    meta: dict[str, Any]
    frames: int

    def array(self, path: str) -> Any:
        """Return an array (frames, columns) as float32."""
        values = np.asarray(self.file[path][: self.frames])
        return values.reshape(self.frames, -1).astype(np.float32)

    def names(self, path: str) -> list[str]:
        """Return the names of an array's columns."""
        return [str(name) for name in self.file[path].attrs["names"]]

    def picture(self, eye: str, frame: int, size: tuple[int, int] | None = None) -> Any:
        """Return a picture (height, width, 3) RGB, resized to ``size`` (width, height) if given."""
        group = self.file[f"images/{eye}"]
        begin, end = group["offset"][frame : frame + 2]
        picture = cv2.imdecode(np.asarray(group["data"][begin:end]), cv2.IMREAD_COLOR)
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        if size is not None and picture.shape[1::-1] != size:
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        return picture


def collected_episodes(roots: Sequence[Path]) -> Iterator[CollectedEpisode]:
    """Yield the successful episodes of data sets, one open at a time."""
    for root in roots:
        for path in sorted((root / "episodes").glob("*.h5")):
            with h5py.File(path, "r") as file:
                meta = json.loads(file.attrs["meta"])
                if meta["verdict"] == "success":
                    yield CollectedEpisode(file, meta, meta["verdict_frame"])


def held_gaits(requests: Any, states: Any) -> Any:
    """Return the gait of each frame (frames,) from its request until the feet stand again."""
    held = np.zeros(len(requests))
    for begin in np.flatnonzero(requests).tolist():
        steps = np.flatnonzero(states[begin:] > 1) + begin
        standing: Any = np.flatnonzero(states[steps[0] :] <= 1) if len(steps) else []
        end = steps[0] + standing[0] if len(standing) else len(requests)
        held[begin:end] = requests[begin]
    return held


def check_equal(what: str, got: Any, expected: Any) -> int:
    """Check that numbers are equal to the bit; return how many were compared.

    Raises:
        MismatchError: the numbers differ.
    """
    got, expected = np.asarray(got), np.asarray(expected)
    if got.shape != expected.shape or not np.array_equal(got, expected):
        raise MismatchError(
            f"{what}: expected {expected.shape} {expected.reshape(-1)[:6]}, got {got.shape} "
            f"{got.reshape(-1)[:6]}"
        )
    return int(got.size)


def psnr(got: Any, expected: Any) -> float:
    """Return the peak signal-to-noise ratio of two 8-bit pictures [dB], infinite if equal."""
    error = float(np.mean((got.astype(np.float64) - expected.astype(np.float64)) ** 2))
    return float(10 * np.log10(255**2 / error)) if error > 0 else float("inf")
