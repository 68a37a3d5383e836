"""Sizes, times and lists of topics as people write them: ``2GB``, ``10min``, ``plant/*,wbc/**``."""

import re

from pydantic import ByteSize, TypeAdapter, ValidationError

from services.logger.errors import LoggerError

_SIZE = TypeAdapter(ByteSize)
_SECONDS = {"": 1.0, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}
_TIME = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([A-Za-z]*)\s*")


def parse_size(text: str) -> int:
    """Return a size in bytes.

    Raises:
        LoggerError: ``text`` is not a size.
    """
    try:
        return int(_SIZE.validate_python(text))
    except ValidationError as error:
        raise LoggerError(f"{text!r} is not a size; expected e.g. 2GB or 500MiB") from error


def parse_duration(text: str) -> float:
    """Return a length of time in seconds.

    Raises:
        LoggerError: ``text`` is not a length of time.
    """
    match = _TIME.fullmatch(text)
    factor = _SECONDS.get(match[2].lower()) if match else None
    if match is None or factor is None:
        raise LoggerError(f"{text!r} is not a time; expected e.g. 10min, 90s or 1h")
    return float(match[1]) * factor


def parse_patterns(text: str) -> tuple[str, ...]:
    """Split patterns of topics at commas and blanks, for every option that takes some."""
    return tuple(part for part in re.split(r"[\s,]+", text) if part)


def format_size(size: float) -> str:
    """Return a size [bytes] in kB, MB or GB."""
    for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size:.0f} B"


def format_duration(seconds: float) -> str:
    """Return a time as minutes:seconds, with hours if there are any."""
    whole = max(0, int(seconds))
    hours, minutes = whole // 3600, whole // 60 % 60
    text = f"{minutes:02}:{whole % 60:02}"
    return f"{hours}:{text}" if hours else text
