"""Keep the images of one camera, evenly spaced over a run of any length."""

from bisect import bisect_right

from common.schemas import CameraFrame
from lab.review.message_spool import MessageSpool

MAX_IMAGES = 4000
"""Images kept; when there are more, every other one is dropped and half as many are taken on."""


class ImageSeries:
    """Images of one camera by the index of the ground truth that they came after."""

    def __init__(self) -> None:
        """Start without images."""
        self._indices: list[int] = []
        self._frames = MessageSpool(CameraFrame)
        self._stride = 1
        """Least difference between two indices."""

    def __len__(self) -> int:
        return len(self._indices)

    def add(self, index: int, frame: CameraFrame) -> None:
        """Keep ``frame`` unless it comes too soon after the one before.

        Raises:
            TrillError: the temporary file cannot be written.
        """
        if self._indices and index - self._indices[-1] < self._stride:
            return
        self._indices.append(index)
        self._frames.append(frame)
        if len(self) > MAX_IMAGES:
            self._stride *= 2
            self._indices, self._frames = self._indices[::2], self._frames[::2]

    def at(self, index: int) -> CameraFrame | None:
        """Return the last image at or before ``index``; None before the first."""
        place = bisect_right(self._indices, index) - 1
        return self._frames[place] if place >= 0 else None

    def halve_indices(self) -> None:
        """Follow a timeline that drops every other ground truth."""
        self._indices = [index // 2 for index in self._indices]
        self._stride = max(1, self._stride // 2)
