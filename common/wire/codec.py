"""Encode and decode messages: one msgpack map of all fields, arrays as little-endian bytes.

The header travels as the field ``header`` and is given apart from the message, so a publisher
stamps it without copying the message. Decoding checks everything that the schema requires and
raises nothing but :class:`~common.errors.SchemaError`, whatever the bytes are. Arrays become
read-only views on the received bytes.
"""

import threading
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from functools import cache
from typing import Any, TypeVar, cast

import msgpack
import numpy as np
from pydantic import BaseModel, ValidationError

from common.errors import SchemaError
from common.native import kernel
from common.schemas import Header, Message
from common.wire.arrays import ArrayLayout, array_layout, view_arrays
from common.wire.builder import message_builder
from common.wire.compatibility import Compatibility, adapt, compatibility
from common.wire.schema import describe_array, schema_hash, schema_tag

__all__ = ["MAX_PAYLOAD", "decode", "encode", "schema_hash", "schema_tag"]

M = TypeVar("M", bound=Message)

_codec: Any = kernel("common.wire._codec")

MAX_PAYLOAD = 64 * 1024 * 1024
"""Longest payload decoded [bytes]."""

# A few bytes of msgpack can announce huge containers, one inside the other; no message needs them.
_MAX_ITEMS = 128
_FIXMAP = 15
"""Most fields whose number takes one byte."""
_MAX_ERROR = 380
_MAX_NAME = 40


@dataclass(frozen=True)
class _Plan:
    """Everything about a schema that is computed once.

    Attributes:
        tag: of the schema.
        names: of its fields.
        body: name, packed name and whether it is an array, of each field but the header.
        prefix: first bytes of every message, up to its header.
        head: length of the map header of everything but the header [bytes].
        arrays: its array fields.
        build: makes a message from its fields.
    """

    tag: str
    names: frozenset[str]
    body: tuple[tuple[str, bytes, bool], ...]
    prefix: bytes
    head: int
    arrays: ArrayLayout
    build: Callable[[dict[str, Any]], Message]


def encode(message: Message, header: Header) -> bytes:
    """Return ``message`` as bytes, with ``header`` in place of its own.

    Raises:
        SchemaError: a value does not fit the wire, e.g. an integer beyond 64 bits.
    """
    return with_header(message, encode_body(message), header.__dict__)


def encode_body(message: Message) -> bytes:
    """Return everything but the header as a msgpack map, for :func:`with_header`.

    It is a step of its own so that the header can carry its duration.

    Raises:
        SchemaError: a value does not fit the wire, e.g. an integer beyond 64 bits.
    """
    plan = _plan(type(message))
    if _codec is not None and (packed := _codec.pack(plan.body, message.__dict__)) is not None:
        return cast(bytes, packed)
    fields = dict(message.__dict__)
    del fields["header"]
    for name in plan.arrays.specs:
        fields[name] = fields[name].tobytes()
    return _packed(message, fields)


def with_header(message: Message, body: bytes, header: dict[str, Any]) -> bytes:
    """Return the whole of ``message`` from its encoded body and the header's fields.

    Args:
        message: what ``body`` was made from.
        body: from :func:`encode_body`.
        header: the fields of a header, in the order of the schema.

    Raises:
        SchemaError: a value of the header does not fit the wire.
    """
    plan = _plan(type(message))
    # The body's own map header makes way for that of the whole.
    if _codec is not None:
        whole = _codec.pack_with_header(plan.prefix, _HEADER, header, body, plan.head)
        if whole is not None:
            return cast(bytes, whole)
    return b"".join((plan.prefix, _packed(message, header), body[plan.head :]))


def _packed(message: Message, fields: dict[str, Any]) -> bytes:
    try:
        return cast(bytes, _packers.pack(fields))
    except (ValueError, TypeError, OverflowError) as error:
        raise SchemaError(
            f"{type(message).__name__} does not fit the wire: {error}; expected 64-bit integers, "
            "valid text and the types of the schema"
        ) from error


def decode(payload: bytes, schema: type[M], tag: str | None = None, injected_ns: int = 0) -> M:
    """Return the message in ``payload``; its arrays are read-only.

    Args:
        payload: bytes made by :func:`encode`, or anything.
        schema: the expected message type.
        tag: the sender's :func:`schema_tag`; another version than this is read by the rule of
            :mod:`common.wire.compatibility` or refused. None: not checked.
        injected_ns: delay injected on the way [ns], noted in the header; 0 leaves it as it is.

    Raises:
        SchemaError: the payload is not such a message; the text names the differing fields.
    """
    plan = _plan(schema)
    if tag is None or tag == plan.tag:
        fields = _unpack(payload, schema)
    else:
        fields = _unpack_other(payload, schema, plan, tag)
    if fields.keys() != plan.names:
        raise SchemaError(_limited(f"{schema.__name__}: {'; '.join(_differences(fields, plan))}"))
    if injected_ns and isinstance(fields["header"], dict):
        fields["header"]["injected"] = injected_ns
    if plan.arrays.sizes:
        _view_arrays(fields, plan, schema)
    try:
        return cast(M, plan.build(fields))
    except ValidationError as error:
        texts = (
            f"{'.'.join(str(part) for part in item['loc'])}: {item['msg']}"
            for item in error.errors(include_url=False, include_input=False, include_context=False)
        )
        raise SchemaError(_limited(f"{schema.__name__}: {'; '.join(texts)}")) from error


def _unpack(payload: bytes, schema: type[Message]) -> dict[str, Any]:
    """Return the top-level map of a payload, with nothing about it checked."""
    if len(payload) > MAX_PAYLOAD:
        raise SchemaError(
            f"{schema.__name__}: payload of {len(payload)} bytes; expected at most {MAX_PAYLOAD}"
        )
    try:
        fields = msgpack.unpackb(
            payload, max_array_len=_MAX_ITEMS, max_map_len=_MAX_ITEMS, max_ext_len=0
        )
    # What malformed msgpack raises is ValueError and its subclasses, but extension types may
    # raise others; whatever it is, it is the payload's fault.
    except (ValueError, TypeError, OverflowError, RecursionError) as error:
        reason = str(error) or type(error).__name__
        raise SchemaError(
            _limited(f"{schema.__name__}: payload is not one msgpack map: {reason}")
        ) from error
    if not isinstance(fields, dict):
        raise SchemaError(f"{schema.__name__}: expected a msgpack map, got {type(fields).__name__}")
    return fields


def _unpack_other(payload: bytes, schema: type[Message], plan: _Plan, tag: str) -> dict[str, Any]:
    """Return the top-level map of a message of another version, as this version would have it."""
    found = compatibility(schema, tag)
    if found.refusal:
        raise _mismatch(payload, plan, tag, found)
    fields = _unpack(payload, schema)
    adapt(fields, schema, tag)
    return fields


def _view_arrays(fields: dict[str, Any], plan: _Plan, schema: type[Message]) -> None:
    """Replace the array fields' bytes by checked read-only views."""
    try:
        if view_arrays(fields, plan.arrays):
            return
    except SchemaError as error:
        raise SchemaError(f"{schema.__name__}: {error}") from error
    raise SchemaError(_limited(f"{schema.__name__}: {'; '.join(_differences(fields, plan))}"))


def _differences(fields: dict[str, Any], plan: _Plan) -> list[str]:
    """List the fields in which a received map visibly differs from the schema."""
    found = {name if isinstance(name, str) else repr(name) for name in fields}
    texts = [f"unknown field {name[:_MAX_NAME]!r}" for name in sorted(found - plan.names)[:5]]
    texts += [f"missing field {name!r}" for name in sorted(plan.names - found)]
    for (name, spec), size in zip(plan.arrays.specs.items(), plan.arrays.sizes, strict=True):
        piece = fields.get(name)
        if name in fields and not (isinstance(piece, bytes) and len(piece) == size):
            got = f"{len(piece)} bytes" if isinstance(piece, bytes) else type(piece).__name__
            texts.append(
                f"field {name!r}: expected {size} bytes ({describe_array(spec)}), got {got}"
            )
    return texts


def _mismatch(payload: bytes, plan: _Plan, tag: str, found: Compatibility) -> SchemaError:
    """Explain why a schema cannot be read, by the tags and by the fields of the message."""
    try:
        texts = _differences(_unpack(payload, Message), plan)
    except SchemaError as error:
        texts = [str(error)]
    differing = (
        "; ".join([found.refusal, *texts])
        if texts
        else (f"{found.refusal}; field names and sizes agree, so types or enumerations differ")
    )
    got = repr(_identity(tag)) if tag else "no schema"
    return SchemaError(
        _limited(
            f"schema mismatch: received {got}, expected {_identity(plan.tag)!r}: {differing}; run "
            "the same version on both sides"
        )
    )


def _identity(tag: str) -> str:
    """Shorten a tag to the part before the optional fields."""
    return ";".join(tag.split(";", 2)[:2])[: 2 * _MAX_NAME]


@cache
def _plan(schema: type[Message]) -> _Plan:
    """Compute what encoding and decoding ``schema`` need."""
    arrays = array_layout(schema)
    return _Plan(
        tag=schema_tag(schema),
        names=frozenset(schema.model_fields),
        body=_fields((name for name in schema.model_fields if name != "header"), arrays),
        prefix=_prefix(len(schema.model_fields)),
        head=1 if len(schema.model_fields) <= _FIXMAP + 1 else 3,
        arrays=arrays,
        build=message_builder(schema),
    )


def _fields(names: Iterable[str], arrays: ArrayLayout) -> tuple[tuple[str, bytes, bool], ...]:
    """Return name, packed name and whether it is an array, of some fields."""
    pack = msgpack.Packer().pack
    return tuple((name, pack(name), name in arrays.specs) for name in names)


def _prefix(fields: int) -> bytes:
    """Return the map header for a number of fields, and the name of the first, the header."""
    packer = msgpack.Packer()
    return cast(bytes, packer.pack_map_header(fields) + packer.pack("header"))


def _plain(value: object) -> object:
    """Return a nested model as a map and a nested array as bytes."""
    if isinstance(value, BaseModel):
        return value.__dict__
    if isinstance(value, np.ndarray):
        return value.tobytes()
    raise TypeError(f"cannot carry {type(value).__name__}")


class _Packers(threading.local):
    """One packer a thread, since making one costs more than packing a message."""

    def __init__(self) -> None:
        self.pack = msgpack.Packer(default=_plain).pack


_packers = _Packers()
_HEADER = _fields(Header.model_fields, array_layout(Header))


def _limited(text: str) -> str:
    """Keep an error text short enough to be carried in a health message."""
    return text if len(text) <= _MAX_ERROR else f"{text[:_MAX_ERROR]}…"
