"""Messages to bytes and back: one msgpack map of all fields, arrays as little-endian bytes.

The header travels as the field ``header`` and is given apart from the message, so a publisher
stamps what it sends without copying the message. Decoding checks everything the schema says and
raises nothing but :class:`~common.errors.SchemaError`, whatever the bytes are.

All arrays of a message are checked at once: they are joined to one block whose finiteness is one
operation, and each field becomes a read-only view on it.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from itertools import accumulate
from operator import itemgetter
from typing import Any, TypeVar, cast

import msgpack
import numpy as np
from pydantic import BaseModel, ValidationError
from pydantic_core import SchemaValidator, core_schema

from common.errors import SchemaError
from common.schemas import Header, Message
from common.schemas.arrays import UNIT_TOLERANCE, ArraySpec, Float64Array
from common.wire.schema import array_spec, describe_array, schema_hash, schema_tag

__all__ = ["MAX_PAYLOAD", "decode", "encode", "schema_hash", "schema_tag"]

M = TypeVar("M", bound=Message)

MAX_PAYLOAD = 64 * 1024 * 1024
"""Longest payload decoded [bytes]."""

# A few bytes of msgpack can announce huge containers, one inside the other; no message needs them.
_MAX_ITEMS = 128
_FIXMAP = 15
"""Most fields whose number takes one byte."""
_MAX_ERROR = 380
_MAX_NAME = 40


@dataclass(frozen=True)
class _Arrays:
    """The array fields of a schema and their places in the joined block."""

    specs: dict[str, ArraySpec]
    sizes: tuple[int, ...]
    """Bytes of each."""
    pieces_of: Callable[[Any], tuple[Any, ...]]
    """Takes their values out of a map."""
    views_of: Callable[[Any], tuple[Float64Array, ...]]
    """Takes their views out of the block."""
    shaped: tuple[tuple[str, tuple[int, ...]], ...]
    """Those with more than one dimension."""
    units: tuple[str, ...]


@dataclass(frozen=True)
class _Plan:
    """What is worked out once per schema."""

    tag: str
    names: frozenset[str]
    prefix: bytes
    """What every message begins with, up to its header."""
    arrays: _Arrays
    build: Callable[[dict[str, Any]], Message]


def encode(message: Message, header: Header) -> bytes:
    """Return ``message`` as bytes, with ``header`` in place of its own.

    Raises:
        SchemaError: a value does not fit the wire, e.g. an integer beyond 64 bits.
    """
    return with_header(message, encode_body(message), header.__dict__)


def encode_body(message: Message) -> bytes:
    """Return everything but the header as a msgpack map, for :func:`with_header`.

    Apart, so that the header can tell how long this took.

    Raises:
        SchemaError: a value does not fit the wire, e.g. an integer beyond 64 bits.
    """
    fields = dict(message.__dict__)
    del fields["header"]
    for name in _plan(type(message)).arrays.specs:
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
    # The body's own map header, of one or three bytes, makes way for that of the whole.
    rest = memoryview(body)[1 if len(plan.names) <= _FIXMAP + 1 else 3 :]
    return b"".join((plan.prefix, _packed(message, header), rest))


def _packed(message: Message, fields: dict[str, Any]) -> bytes:
    try:
        return cast(bytes, msgpack.packb(fields, default=_plain))
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
        tag: what the sender called its schema; refused unless it is this schema's
            :func:`schema_tag`. None: not checked.
        injected_ns: delay injected on the way [ns], noted in the header; 0 leaves it as it is.

    Raises:
        SchemaError: the payload is not such a message; the text names the differing fields.
    """
    plan = _plan(schema)
    if tag is not None and tag != plan.tag:
        raise _mismatch(payload, plan, tag)
    fields = _unpack(payload, schema)
    if fields.keys() != plan.names:
        raise SchemaError(_limited(f"{schema.__name__}: {'; '.join(_differences(fields, plan))}"))
    if injected_ns and isinstance(fields["header"], dict):
        fields["header"]["injected"] = injected_ns
    if plan.arrays.sizes:
        _take_arrays(fields, plan, schema)
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


def _take_arrays(fields: dict[str, Any], plan: _Plan, schema: type[Message]) -> None:
    """Replace the array fields' bytes by checked read-only views."""
    arrays = plan.arrays
    pieces = arrays.pieces_of(fields)
    try:
        fitting = tuple(map(len, pieces)) == arrays.sizes
        block = np.frombuffer(b"".join(pieces), dtype="<f8") if fitting else None
    except TypeError:  # a number has no length, and text does not join with bytes
        block = None
    if block is None:
        text = "; ".join(_differences(fields, plan))
        raise SchemaError(_limited(f"{schema.__name__}: {text}"))
    fields.update(zip(arrays.specs, arrays.views_of(block), strict=True))
    # Looking for a False among the mask's bytes takes a third of the time of `all`.
    if b"\0" in np.isfinite(block).tobytes():
        wrong = ", ".join(name for name in arrays.specs if not np.isfinite(fields[name]).all())
        raise SchemaError(
            f"{schema.__name__}: {wrong}: expected finite numbers, got NaN or infinity"
        )
    for name in arrays.units:
        norm = math.hypot(*fields[name].tolist())
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise SchemaError(
                f"{schema.__name__}: {name}: expected a unit quaternion (w, x, y, z), "
                f"got norm {norm:.6g}"
            )
    for name, shape in arrays.shaped:
        fields[name] = fields[name].reshape(shape)


def _differences(fields: dict[str, Any], plan: _Plan) -> list[str]:
    """Say in which fields a received map differs from the schema, as far as it shows."""
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


def _mismatch(payload: bytes, plan: _Plan, tag: str) -> SchemaError:
    """Explain a schema tag that is not the expected one."""
    try:
        texts = _differences(_unpack(payload, Message), plan)
    except SchemaError as error:
        texts = [str(error)]
    differing = "; ".join(texts) or "field names and sizes agree, so types or enumerations differ"
    got = f"{tag[: 2 * _MAX_NAME]!r}" if tag else "no schema"
    return SchemaError(
        _limited(
            f"schema mismatch: received {got}, expected {plan.tag!r}: {differing}; run the same "
            "version on both sides"
        )
    )


@cache
def _plan(schema: type[Message]) -> _Plan:
    """Work out what encoding and decoding ``schema`` need."""
    return _Plan(
        tag=schema_tag(schema),
        names=frozenset(schema.model_fields),
        prefix=_prefix(len(schema.model_fields)),
        arrays=_arrays(schema),
        build=_builder(schema),
    )


def _prefix(fields: int) -> bytes:
    """The map header for a number of fields, and the name of the first, the header."""
    packer = msgpack.Packer()
    return cast(bytes, packer.pack_map_header(fields) + packer.pack("header"))


def _arrays(schema: type[Message]) -> _Arrays:
    """Lay the array fields of ``schema`` out in one block, in the order of declaration."""
    found = ((name, array_spec(field.metadata)) for name, field in schema.model_fields.items())
    specs = {name: spec for name, spec in found if spec is not None}
    counts = [math.prod(spec.shape) for spec in specs.values()]
    stops = list(accumulate(counts))
    return _Arrays(
        specs=specs,
        sizes=tuple(8 * count for count in counts),
        pieces_of=_getter(list(specs)),
        views_of=_getter([slice(b - n, b) for b, n in zip(stops, counts, strict=True)]),
        shaped=tuple((name, spec.shape) for name, spec in specs.items() if len(spec.shape) != 1),
        units=tuple(name for name, spec in specs.items() if spec.unit),
    )


def _getter(keys: Sequence[Any]) -> Callable[[Any], tuple[Any, ...]]:
    """Like :class:`operator.itemgetter`, but a tuple for any number of keys."""
    if len(keys) > 1:
        return itemgetter(*keys)
    return lambda source: tuple(source[key] for key in keys)


def _builder(schema: type[Message]) -> Callable[[dict[str, Any]], Message]:
    """Return a function that validates a map whose arrays are checked and builds the message.

    Pydantic's own validator would check every array a second time, one by one, which is most of
    the cost of a state message; so the fields are validated with the arrays taken as they are.
    A schema with validators of its own on the whole model takes the general way.
    """
    core = cast(dict[str, Any], schema.__pydantic_core_schema__)
    if core["type"] != "model" or core["schema"]["type"] != "model-fields":
        return schema.model_validate
    fields_schema = _arrays_accepted(core["schema"])
    validate = SchemaValidator(fields_schema, core["config"]).validate_python
    assign = object.__setattr__

    def build(fields: dict[str, Any]) -> Message:
        values, _, fields_set = validate(fields)
        message = schema.__new__(schema)
        assign(message, "__dict__", values)
        assign(message, "__pydantic_fields_set__", fields_set)
        assign(message, "__pydantic_extra__", None)
        assign(message, "__pydantic_private__", None)
        return message

    return build


def _arrays_accepted(fields_schema: dict[str, Any]) -> Any:
    """Return the fields' validation schema with top-level arrays accepted as they are."""
    accepted = {}
    for name, field in fields_schema["fields"].items():
        inner = field["schema"]
        inner = inner["schema"] if inner["type"] == "default" else inner
        function = inner.get("function", {}).get("function")
        is_array = isinstance(getattr(function, "__self__", None), ArraySpec)
        accepted[name] = {**field, "schema": core_schema.any_schema()} if is_array else field
    return {**fields_schema, "fields": accepted}


def _plain(value: object) -> object:
    """Return a nested model as a map and a nested array as bytes."""
    if isinstance(value, BaseModel):
        return value.__dict__
    if isinstance(value, np.ndarray):
        return value.tobytes()
    raise TypeError(f"cannot carry {type(value).__name__}")


def _limited(text: str) -> str:
    """Keep an error text short enough to be carried in a health message."""
    return text if len(text) <= _MAX_ERROR else f"{text[:_MAX_ERROR]}…"
