"""Describe a message schema on the wire: its fields in words, its hash and its tag.

The description covers field names, types, array shapes and enumeration values. It is derived
from the declaration itself rather than from a generated JSON schema, so two hosts with different
versions of the validation library agree on it. Limits such as "not negative" are checked on
decoding but are not part of it: changing a limit does not change the wire.

The tag that travels with every message and stands in logs is::

    trill/<name>/<version>;<hash of the required fields>;<digests of the optional fields>

A field is optional if it has a default. Each optional field, also of a nested model, has a digest
of its own, so that two versions of a schema can be compared by their tags alone; see
:mod:`common.wire.compatibility` for the rule.
"""

import hashlib
import json
from collections.abc import Iterable
from dataclasses import dataclass
from enum import Enum
from functools import cache
from types import NoneType
from typing import Annotated, Any, Literal, NamedTuple, get_args, get_origin

from pydantic import BaseModel

from common.errors import SchemaError
from common.schemas import Message
from common.schemas.arrays import ArraySpec

MAX_TAG = 235
"""Longest schema tag [characters]: with the encoding's own name the transport takes 255 bytes, and
a longer one would break the session."""

_SCALARS = {bool: "bool", int: "int", float: "float64", str: "str", bytes: "bytes", NoneType: "nil"}
_HASH_LENGTH = 12
_DIGEST_LENGTH = 4


@dataclass(frozen=True)
class WireFields:
    """Types in words of a schema's fields, e.g. ``{"base_position": "float64[3]"}``.

    Attributes:
        required: by name; a nested model's words name its required fields only.
        optional: fields with a default, by path; ``links.late`` is the field ``late`` of each
            model in the field ``links``.
    """

    required: dict[str, str]
    optional: dict[str, str]


@cache
def describe(schema: type[BaseModel]) -> WireFields:
    """Describe the fields of a schema.

    Raises:
        SchemaError: a field has a type the bus cannot carry.
    """
    required: dict[str, str] = {}
    optional: dict[str, str] = {}
    always_sent: frozenset[str] = getattr(schema, "ALWAYS_SENT", frozenset())
    for name, field in schema.model_fields.items():
        try:
            words = _describe(field.annotation, field.metadata)
        except TypeError as error:
            raise SchemaError(f"{schema.__name__}.{name}: {error}") from error
        is_required = field.is_required() or name in always_sent
        (required if is_required else optional)[name] = words
        nested = model_in(field.annotation)
        if nested is not None:
            paths = describe(nested).optional
            optional |= {f"{name}.{path}": words for path, words in paths.items()}
    return WireFields(required, optional)


@cache
def schema_hash(schema: type[Message]) -> str:
    """Return 12 hexadecimal digits of the SHA-256 of name, version and required fields."""
    content = [schema.__name__, schema.VERSION, describe(schema).required]
    return _hash(json.dumps(content, sort_keys=True), _HASH_LENGTH)


@cache
def optional_digests(schema: type[Message]) -> dict[str, str]:
    """Return the path of each optional field of a schema by its digest in the tag.

    Raises:
        SchemaError: two fields have the same digest.
    """
    paths: dict[str, str] = {}
    for path, words in sorted(describe(schema).optional.items()):
        digest = _hash(f"{path}={words}", _DIGEST_LENGTH)
        if digest in paths:
            raise SchemaError(
                f"{schema.__name__}: the fields {paths[digest]} and {path} have the same digest; "
                "rename one of them"
            )
        paths[digest] = path
    return paths


@cache
def schema_tag(schema: type[Message]) -> str:
    """Return what the wire calls this schema, e.g. ``trill/PlantState/1;0123456789ab;12ab``.

    Raises:
        SchemaError: a field has a type the bus cannot carry, or there are too many optional fields.
    """
    tag = f"trill/{schema.__name__}/{schema.VERSION};{schema_hash(schema)}"
    if digests := sorted(optional_digests(schema)):
        tag += f";{''.join(digests)}"
    if len(tag) > MAX_TAG:
        raise SchemaError(
            f"{schema.__name__}: {len(digests)} optional fields do not fit a tag of {MAX_TAG} "
            "characters; make some of them required"
        )
    return tag


class ParsedTag(NamedTuple):
    """The parts of a schema tag."""

    name: str
    """Of the schema, with its version."""
    hash: str
    """Of the required fields."""
    digests: frozenset[str]
    """Of the optional fields."""


def parse_tag(tag: str) -> ParsedTag | None:
    """Split a tag into its parts; None if it is no schema tag of this project."""
    name, *rest = tag.split(";")
    if not name.startswith("trill/") or not 1 <= len(rest) <= 2:
        return None
    text, length = "".join(rest[1:]), _DIGEST_LENGTH
    digests = frozenset(text[start : start + length] for start in range(0, len(text), length))
    return ParsedTag(name, rest[0], digests)


def array_spec(metadata: Iterable[object]) -> ArraySpec | None:
    """Return the array specification among a field's annotations."""
    return next((entry for entry in metadata if isinstance(entry, ArraySpec)), None)


def describe_array(spec: ArraySpec) -> str:
    """Write an array's type in words, e.g. ``float64[4] unit``."""
    shape = ",".join(str(size) for size in spec.shape)
    return f"float64[{shape}]{' unit' if spec.unit else ''}"


def _hash(text: str, length: int) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:length]


def model_in(annotation: Any) -> type[BaseModel] | None:
    """Return the model that a field's type is, or is a list of."""
    while get_origin(annotation) in {Annotated, list}:
        annotation = get_args(annotation)[0]
    is_model = isinstance(annotation, type) and issubclass(annotation, BaseModel)
    return annotation if is_model else None


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
        required = describe(annotation).required.items()
        text = f"{annotation.__name__}{{{', '.join(f'{name}: {text}' for name, text in required)}}}"
    if text is not None:
        return text
    raise TypeError(
        f"the bus cannot carry {annotation}; expected a scalar, an enumeration, an array with an "
        "ArraySpec, a model, or a list of these"
    )
