"""A recording that was interrupted goes on in a new file beside the first, log-2.mcap."""

from itertools import count
from pathlib import Path


def part(path: Path, number: int) -> Path:
    """Path of a recording's part; number 1 is ``path`` itself."""
    return path if number == 1 else path.with_stem(f"{path.stem}-{number}")


def existing_parts(path: Path) -> list[Path]:
    """The parts of the recording at ``path``, in order; at least ``path``, existing or not."""
    parts = [path]
    for number in count(2):
        candidate = part(path, number)
        if not candidate.exists():
            return parts
        parts.append(candidate)
    return parts


def next_part(path: Path) -> Path:
    """The first part of the recording at ``path`` that does not exist yet."""
    return next(p for p in (part(path, n) for n in count(1)) if not p.exists())
