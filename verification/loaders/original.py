"""Collected episodes as they are in their files, for comparison."""

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
    """What a loader gave is not what was collected."""


@dataclass(frozen=True)
class Original:
    """A successful episode up to the judge's verdict.

    Attributes:
        file: open HDF5 file.
        meta: its description.
        frames: before the verdict.
    """

    file: Any
    meta: dict[str, Any]
    frames: int

    def array(self, path: str) -> Any:
        """One array (frames, columns), as float32."""
        values = np.asarray(self.file[path][: self.frames])
        return values.reshape(self.frames, -1).astype(np.float32)

    def names(self, path: str) -> list[str]:
        """Names of an array's columns."""
        return [str(name) for name in self.file[path].attrs["names"]]

    def picture(self, eye: str, frame: int, size: tuple[int, int] | None = None) -> Any:
        """One picture (height, width, 3) RGB, at ``size`` (width, height) if given."""
        group = self.file[f"images/{eye}"]
        begin, end = group["offset"][frame : frame + 2]
        picture = cv2.imdecode(np.asarray(group["data"][begin:end]), cv2.IMREAD_COLOR)
        picture = cv2.cvtColor(picture, cv2.COLOR_BGR2RGB)
        if size is not None and picture.shape[1::-1] != size:
            picture = cv2.resize(picture, size, interpolation=cv2.INTER_AREA)
        return picture


def originals(roots: Sequence[Path]) -> Iterator[Original]:
    """The episodes of some data sets, one open at a time."""
    for root in roots:
        for path in sorted((root / "episodes").glob("*.h5")):
            with h5py.File(path, "r") as file:
                meta = json.loads(file.attrs["meta"])
                if meta["verdict"] == "success":
                    yield Original(file, meta, meta["verdict_frame"])


def same(what: str, got: Any, expected: Any) -> int:
    """Check that numbers are equal to the bit; returns how many there were.

    Raises:
        MismatchError: they are not.
    """
    got, expected = np.asarray(got), np.asarray(expected)
    if got.shape != expected.shape or not np.array_equal(got, expected):
        raise MismatchError(
            f"{what}: expected {expected.shape} {expected.reshape(-1)[:6]}, got {got.shape} "
            f"{got.reshape(-1)[:6]}"
        )
    return int(got.size)


def psnr(got: Any, expected: Any) -> float:
    """Peak signal-to-noise ratio of two 8-bit pictures [dB]; infinite if they are equal."""
    error = float(np.mean((got.astype(np.float64) - expected.astype(np.float64)) ** 2))
    return float(10 * np.log10(255**2 / error)) if error > 0 else float("inf")
