"""What a message schema looks like on the wire, in words; its hash and its tag.

The description covers field names, types, array shapes and enumeration values. It is derived
from the declaration itself rather than from a generated JSON schema, so two hosts with different
versions of the validation library agree on it. Limits such as "not negative" are checked on
decoding but are not part of it: changing a limit does not change the wire.
"""

import hashlib
import json
from collections.abc import Iterable
from enum import Enum
from functools import cache
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import BaseModel

from common.errors import SchemaError
from common.schemas import Message
from common.schemas.arrays import ArraySpec

_SCALARS = {bool: "bool", int: "int", float: "float64", str: "str", bytes: "bytes", NoneType: "nil"}
_HASH_LENGTH = 12


@cache
def describe(schema: type[BaseModel]) -> dict[str, str]:
    """Return field name -> type in words, e.g. ``{"base_position": "float64[3]"}``.

    Raises:
        SchemaError: a field has a type the bus cannot carry.
    """
    result = {}
    for name, field in schema.model_fields.items():
        try:
            result[name] = _describe(field.annotation, field.metadata)
        except TypeError as error:
            raise SchemaError(f"{schema.__name__}.{name}: {error}") from error
    return result


@cache
def schema_hash(schema: type[Message]) -> str:
    """Return 12 hexadecimal digits of the SHA-256 of name, version and :func:`describe`."""
    text = json.dumps([schema.__name__, schema.VERSION, describe(schema)], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:_HASH_LENGTH]


@cache
def schema_tag(schema: type[Message]) -> str:
    """Return what the wire calls this schema, e.g. ``trill/PlantState/1;0123456789ab``."""
    return f"trill/{schema.__name__}/{schema.VERSION};{schema_hash(schema)}"


def array_spec(metadata: Iterable[object]) -> ArraySpec | None:
    """Return the array specification among a field's annotations."""
    return next((entry for entry in metadata if isinstance(entry, ArraySpec)), None)


def describe_array(spec: ArraySpec) -> str:
    """Write an array's type in words, e.g. ``float64[4] unit``."""
    shape = ",".join(str(size) for size in spec.shape)
    return f"float64[{shape}]{' unit' if spec.unit else ''}"


def _describe(annotation: Any, metadata: Iterable[object] = ()) -> str:
    """Write one type in words; TypeError if the bus cannot carry it."""
    spec = array_spec(metadata)
    if spec is not None:
        return describe_array(spec)
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    origin, arguments = get_origin(annotation), get_args(annotation)
    text = None
    if origin is Annotated:
        text = _describe(arguments[0], arguments[1:])
    elif origin is Literal:
        text = "one of " + ", ".join(repr(value) for value in arguments)
    elif origin is list:
        text = f"list of {_describe(arguments[0])}"
    elif isinstance(annotation, type) and issubclass(annotation, Enum):
        members = ", ".join(f"{member.name}={member.value!r}" for member in annotation)
        text = f"{annotation.__name__}({members})"
    elif isinstance(annotation, type) and issubclass(annotation, BaseModel):
        inner = ", ".join(f"{name}: {text}" for name, text in describe(annotation).items())
        text = f"{annotation.__name__}{{{inner}}}"
    if text is not None:
        return text
    raise TypeError(
        f"the bus cannot carry {annotation}; expected a scalar, an enumeration, an array with an "
        "ArraySpec, a model, or a list of these"
    )
