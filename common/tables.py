"""Configuration tables laid over one another."""

from collections.abc import Mapping
from typing import Any


def overlaid(base: Mapping[str, Any], overlay: Mapping[str, Any]) -> dict[str, Any]:
    """Return ``base`` with ``overlay`` laid over it, tables merged recursively."""
    result = dict(base)
    for key, value in overlay.items():
        old = result.get(key)
        if isinstance(old, Mapping) and isinstance(value, Mapping):
            result[key] = overlaid(old, value)
        else:
            result[key] = value
    return result
