"""Writes the pictures of successive episodes as mp4 files of a limited size."""

from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Any

import av

from common.episodes.episode_file import Image
from lab.errors import DatasetError

CODEC, _ENCODER = "h264", "libx264"
PIXEL_FORMAT = "yuv420p"
"""Every decoder can read this pixel format."""
KEYFRAME_INTERVAL = 2
"""Every second picture is a key frame, as in lerobot, so that any picture is found quickly."""
_BT601, _LIMITED_RANGE = 6, 1
"""Colour space SMPTE 170M, 16 to 235; written to the file, since decoders guess it by the size."""


@dataclass(frozen=True)
class VideoSegment:
    """The part of a video file that shows one episode.

    Attributes:
        file: number of the file.
        begin: time of the episode's first picture [s].
        end: time after its last picture [s].
    """

    file: int
    begin: float
    end: float


class VideoFiles:
    """Video files of one camera; a new file is begun only between episodes."""

    def __init__(
        self, folder: Path, size: tuple[int, int], rate: int, *, crf: int, limit: int
    ) -> None:
        """Prepare the files; none is written before the first episode.

        Args:
            folder: folder of the files.
            size: width and height [pixels]; even numbers.
            rate: pictures per second.
            crf: quality, 0 best to 51.
            limit: size beyond which a file gets no more episodes [bytes].

        Raises:
            DatasetError: width or height is odd.
        """
        if size[0] % 2 or size[1] % 2:
            raise DatasetError(
                f"video needs an even width and height, got {size[0]}x{size[1]}; give other "
                "--width and --height, or --pictures embedded"
            )
        self._folder, self._size, self._rate = folder, size, rate
        self._crf, self._limit = crf, limit
        self._file, self._frames, self._begin = -1, 0, 0
        self._container: Any = None
        self._stream: Any = None

    def begin_episode(self) -> None:
        """Begin the next episode, in a new file if the last one is large enough."""
        if self._container is None or self._path().stat().st_size > self._limit:
            self.close()
            self._open()
        self._begin = self._frames

    def _path(self) -> Path:
        return self._folder / f"file-{self._file:03d}.mp4"

    def _open(self) -> None:
        self._file += 1
        self._frames = 0
        self._folder.mkdir(parents=True, exist_ok=True)
        self._container = av.open(str(self._path()), "w")
        # Without B-frames the first time stamp of the file is 0 for every decoder.
        options = {"crf": str(self._crf), "g": str(KEYFRAME_INTERVAL), "bf": "0"}
        stream = self._container.add_stream(_ENCODER, rate=self._rate, options=options)
        stream.width, stream.height = self._size
        stream.pix_fmt = PIXEL_FORMAT
        stream.codec_context.time_base = Fraction(1, self._rate)
        stream.codec_context.colorspace = _BT601
        stream.codec_context.color_range = _LIMITED_RANGE
        self._stream = stream

    def add(self, picture: Image) -> None:
        """Append one picture (height, width, 3) RGB."""
        whole = av.VideoFrame.from_ndarray(picture, format="rgb24")
        frame = whole.reformat(format=PIXEL_FORMAT, interpolation="AREA")
        frame.pts, frame.time_base = self._frames, Fraction(1, self._rate)
        self._container.mux(self._stream.encode(frame))
        self._frames += 1

    def end_episode(self) -> VideoSegment:
        """Return the segment of the episode."""
        return VideoSegment(self._file, self._begin / self._rate, self._frames / self._rate)

    def close(self) -> None:
        """Finish the file."""
        if self._container is None:
            return
        self._container.mux(self._stream.encode(None))
        self._container.close()
        self._container = None
