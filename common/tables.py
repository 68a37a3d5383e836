"""Configuration tables laid over one another."""

from collections.abc import Mapping
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from common.errors import ConfigError, explain

C = TypeVar("C", bound=BaseModel)


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


def validated(schema: type[C], *tables: Mapping[str, Any], what: str = "") -> C:
    """Return the configuration ``schema`` from ``tables``, later ones over earlier ones.

    Raises:
        ConfigError: a value is unknown or out of range; the message names it and ``what`` is wrong.
    """
    merged: dict[str, Any] = {}
    for table in tables:
        merged.update(table)
    try:
        return schema.model_validate(merged)
    except ValidationError as error:
        what = what or f"the configuration of {schema.__name__}"
        raise ConfigError(f"{what} is wrong: {explain(error)}") from error
