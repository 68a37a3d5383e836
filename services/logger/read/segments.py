"""The segments of a recording: after a rotation or a crash it continues in log-2.mcap."""

from itertools import count
from pathlib import Path


def segment(path: Path, number: int) -> Path:
    """Return the path of a recording's segment; number 1 is ``path`` itself."""
    return path if number == 1 else path.with_stem(f"{path.stem}-{number}")


def existing_segments(path: Path) -> list[Path]:
    """Return the segments of the recording at ``path`` in order; ``path`` even if it is missing."""
    segments = [path]
    for number in count(2):
        candidate = segment(path, number)
        if not candidate.exists():
            return segments
        segments.append(candidate)
    return segments


def next_segment(path: Path) -> Path:
    """Return the first segment of the recording at ``path`` that does not exist yet."""
    return next(s for s in (segment(path, n) for n in count(1)) if not s.exists())
