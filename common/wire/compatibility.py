"""Decide whether a message of another version of a schema can be read, and make it readable.

The rule, for messages on the bus and in logs alike:

- Name and version of the schema and all required fields must be the same on both sides, with the
  same types, shapes and enumeration values.
- One side may have optional fields that the other lacks. A reader that knows more gives them
  their defaults. A reader that knows less ignores them; it logs a warning with their names once,
  and the inbox counts the messages (``LinkHealth.adapted``).
- If *each* side has optional fields that the other lacks, the message is refused: a field that
  changed its type, or its name because its unit changed, looks just so.

Both tags say all of this, so no sender needs to be asked. The decision is made once per tag, and
messages of the reader's own version never come here.
"""

import logging
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

from pydantic import BaseModel

from common.schemas import Message
from common.wire.schema import model_in, optional_digests, parse_tag, schema_tag

_REMEMBERED = 256
_MAX_SHOWN = 12
_MAX_NAME = 40
_warned: set[str] = set()
"""Tags of newer versions that a warning was logged for."""

_log = logging.getLogger(__name__)


@dataclass(frozen=True)
class Compatibility:
    """How a reader's version of a schema compares with a sender's.

    Attributes:
        refusal: why messages are refused; empty if they are read.
        missing: paths of the reader's optional fields that the sender lacks or has otherwise.
        unknown: number of the sender's optional fields that the reader lacks or has otherwise.
    """

    refusal: str = ""
    missing: tuple[str, ...] = ()
    unknown: int = 0


@lru_cache(maxsize=_REMEMBERED)
def compatibility(schema: type[Message], tag: str) -> Compatibility:
    """Compare the reader's ``schema`` with the sender's, named by ``tag``."""
    own, other = parse_tag(schema_tag(schema)), parse_tag(tag)
    assert own is not None
    if other is None or (own.name, own.hash) != (other.name, other.hash):
        return Compatibility("name, version or required fields differ")
    paths = optional_digests(schema)
    missing = tuple(path for digest, path in paths.items() if digest not in other.digests)
    unknown = len(other.digests - own.digests)
    refusal = ""
    if missing and unknown:
        refusal = f"the sender has optional fields not known here, but not {_listed(missing)}"
    elif missing:
        _log.info("messages of an older %s get defaults for %s", own.name, _listed(missing))
    return Compatibility(refusal, missing, unknown)


def adapt(fields: dict[str, Any], schema: type[Message], tag: str) -> None:
    """Turn the fields of a message of another version into those of ``schema``, in place.

    Args:
        fields: the message as a map, with arrays as bytes.
        schema: the reader's.
        tag: of the sender's version, which is compatible.
    """
    found = compatibility(schema, tag)
    if found.unknown:
        dropped = _prune(fields, schema)
        if tag not in _warned and len(_warned) < _REMEMBERED:
            _warned.add(tag)
            names = _listed(tuple(sorted(dropped)))
            _log.warning("messages of a newer %s are read without %s", schema.__name__, names)
    for path in found.missing:
        # Those of nested models are filled in when these are validated.
        if path in schema.model_fields and path not in fields:
            value = schema.model_fields[path].get_default(call_default_factory=True)
            fields[path] = value.tobytes() if hasattr(value, "tobytes") else value


def _prune(fields: dict[Any, Any], model: type[BaseModel], prefix: str = "") -> set[str]:
    """Remove the fields that a model and its nested models do not know; returns their paths."""
    unknown = fields.keys() - model.model_fields.keys()
    for name in unknown:
        del fields[name]
    dropped = {f"{prefix}{name}" for name in unknown}
    for name, nested in _nested_models(model):
        value = fields.get(name)
        for each in value if isinstance(value, list) else [value]:
            if isinstance(each, dict):
                dropped |= _prune(each, nested, f"{prefix}{name}.")
    return dropped


@cache
def _nested_models(model: type[BaseModel]) -> list[tuple[str, type[BaseModel]]]:
    found = ((name, model_in(field.annotation)) for name, field in model.model_fields.items())
    return [(name, nested) for name, nested in found if nested is not None]


def _listed(paths: tuple[str, ...]) -> str:
    shown = ", ".join(repr(path[:_MAX_NAME]) for path in paths[:_MAX_SHOWN])
    return shown if len(paths) <= _MAX_SHOWN else f"{shown} and {len(paths) - _MAX_SHOWN} more"
