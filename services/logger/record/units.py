"""Sizes and times as people write them: ``2GB``, ``500MiB``, ``10min``, ``90s``."""

import re

from services.logger.errors import LoggerError

_SIZES = {
    "": 1, "B": 1, "KB": 10**3, "MB": 10**6, "GB": 10**9, "TB": 10**12,
    "KIB": 2**10, "MIB": 2**20, "GIB": 2**30, "TIB": 2**40,
}  # fmt: skip
_TIMES = {"": 1.0, "s": 1.0, "min": 60.0, "m": 60.0, "h": 3600.0}
_NUMBER = re.compile(r"\s*([0-9]+(?:\.[0-9]+)?)\s*([A-Za-z]*)\s*")


def parse_size(text: str) -> int:
    """Bytes of ``text``.

    Raises:
        LoggerError: it is not a size.
    """
    number, unit = _split(text)
    factor = _SIZES.get(unit.upper())
    if number is None or factor is None:
        raise LoggerError(f"{text!r} is not a size; expected for instance 2GB or 500MiB")
    return round(number * factor)


def parse_duration(text: str) -> float:
    """Seconds of ``text``.

    Raises:
        LoggerError: it is not a length of time.
    """
    number, unit = _split(text)
    factor = _TIMES.get(unit.lower())
    if number is None or factor is None:
        raise LoggerError(f"{text!r} is not a time; expected for instance 10min, 90s or 1h")
    return number * factor


def format_size(size: float) -> str:
    """Bytes in the unit that reads best."""
    for factor, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if size >= factor:
            return f"{size / factor:.1f} {unit}"
    return f"{size:.0f} B"


def format_duration(seconds: float) -> str:
    """Seconds as minutes:seconds, with hours if there are any."""
    whole = max(0, int(seconds))
    hours, minutes = whole // 3600, whole // 60 % 60
    text = f"{minutes:02}:{whole % 60:02}"
    return f"{hours}:{text}" if hours else text


def _split(text: str) -> tuple[float | None, str]:
    match = _NUMBER.fullmatch(text)
    return (None, "") if match is None else (float(match[1]), match[2])
