"""The segments of a recording: after a rotation or a crash it continues in log-2.mcap.

The number in a file's name gives its place, and the id of the recording in its first metadata
record says whether it belongs: another recording's ``door-2.mcap`` beside ``door.mcap`` does not.
"""

import re
from dataclasses import dataclass
from pathlib import Path

from mcap.opcode import Opcode
from mcap.records import Metadata

from services.logger.errors import LoggerError
from services.logger.log_format import START_METADATA
from services.logger.read.mcap_file import UNREADABLE, open_mcap


@dataclass(frozen=True)
class Segments:
    """The files found for a recording.

    Attributes:
        paths: its segments, in order; the path that was asked for if there is none.
        missing: names of the segments that are not there although later ones are.
        foreign: files that are named like segments but belong to another recording.
        recording: id of the recording; empty if it is not known.
    """

    paths: list[Path]
    missing: list[str]
    foreign: list[Path]
    recording: str

    def remarks(self) -> list[str]:
        """Return what a reader of the recording should know, a sentence each."""
        found = []
        if self.missing:
            names = ", ".join(self.missing[:3]) + (" …" if len(self.missing) > 3 else "")
            found.append(f"not all of the recording is here: {names} is missing")
        found += [
            f"{path} belongs to another recording and is left out; read it by its own name"
            for path in self.foreign
        ]
        return found


def segment(path: Path, number: int) -> Path:
    """Return the path of a recording's segment; number 1 is ``path`` itself."""
    return path if number == 1 else path.with_stem(f"{path.stem}-{number}")


def find_segments(path: Path) -> Segments:
    """Return the segments of the recording at ``path``."""
    numbered = _numbered(path)
    origins = {number: origin_of(file) for number, file in numbered.items()}
    known = (recording_id(origin) for origin in origins.values() if origin)
    wanted = next(known, "")
    foreign = {number for number, origin in origins.items() if not _belongs(origin, wanted)}
    numbers = [number for number in numbered if number not in foreign]
    missing = [n for n in range(1, max(numbers, default=0)) if n not in numbered]
    return Segments(
        [numbered[number] for number in numbers] or [path],
        [segment(path, number).name for number in missing],
        [numbered[number] for number in sorted(foreign)],
        wanted,
    )


def existing_segments(path: Path) -> list[Path]:
    """Return the segments of the recording at ``path`` in order; ``path`` even if it is missing."""
    return find_segments(path).paths


def last_number(path: Path) -> int:
    """Return the highest number of a file that is named like a segment; 0 if there is none."""
    return max(_numbered(path), default=0)


def next_segment(path: Path, after: int = 0) -> Path:
    """Return a path for a new segment, numbered after ``after`` and every file that is there."""
    return segment(path, max(after, last_number(path)) + 1)


def recording_id(origin: dict[str, str]) -> str:
    """Return the id that all segments of a recording share; empty if it is not known.

    Before it was recorded, the id of the first process that wrote the recording stands for it.
    """
    return origin.get("recording") or origin.get("session", "")


def _numbered(path: Path) -> dict[int, Path]:
    """Return ``path`` and the files named like its segments by their numbers, ascending."""
    name = re.compile(rf"{re.escape(path.stem)}-([1-9][0-9]*){re.escape(path.suffix)}")
    found = {1: path} if path.exists() else {}
    if path.parent.is_dir():
        for file in path.parent.iterdir():
            match = name.fullmatch(file.name)
            if match and int(match[1]) > 1:
                found[int(match[1])] = file
    return dict(sorted(found.items()))


def _belongs(origin: dict[str, str] | None, wanted: str) -> bool:
    """Return whether a file is of the recording ``wanted``; its name decides where no id does."""
    if origin is None or not wanted:
        return True
    if "recording" in origin or not origin:
        return recording_id(origin) == wanted
    return True  # of an earlier version, which did not record the id


def origin_of(path: Path) -> dict[str, str] | None:
    """Return a file's first metadata record; empty if it has none, None if it is unreadable."""
    try:
        with open_mcap(path) as file:
            for span in file.spans():
                if span.opcode == UNREADABLE:
                    return None
                if span.opcode in (Opcode.CHUNK, Opcode.MESSAGE, Opcode.FOOTER):
                    return {}
                for record in file.records(span):
                    if isinstance(record, Metadata) and record.name == START_METADATA:
                        return dict(record.metadata)
    except LoggerError:
        pass
    return None
