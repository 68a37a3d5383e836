"""Compare a replayed message with the recorded one: to the byte, else field by field."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from common.errors import SchemaError
from common.runtime.replay.runs import Recorded
from common.schemas import Message
from common.wire.codec import decode, encode_body, schema_tag, with_header
from common.wire.compatibility import compatibility

_SHOWN = 60


@dataclass(frozen=True)
class FieldDifference:
    """One field that differs.

    Attributes:
        field: its name, ``header.stamp`` for one of the header; an array's with the index of the
            largest difference.
        recorded, replayed: the values, as text.
        delta: the largest difference; infinity where there is no number for it.
        relative: the same by the largest magnitude in the recorded field, or by 1 if that is less.
    """

    field: str
    recorded: str
    replayed: str
    delta: float
    relative: float


def stamped(message: Message, header: dict[str, Any]) -> bytes:
    """The bytes of ``message`` with these header fields."""
    return with_header(message, encode_body(message), header)


def differences(
    recorded: Recorded, message: Message, header: dict[str, Any]
) -> list[FieldDifference]:
    """List the fields in which a message differs from the recorded one; empty: in no byte.

    A message recorded by another version of the schema is compared by the fields both have.

    Args:
        recorded: what was sent then.
        message: what would be sent now.
        header: the fields of its header.
    """
    if stamped(message, header) == recorded.payload:
        return []
    schema: type[Message] = recorded.topic.schema
    try:
        then = decode(recorded.payload, schema, recorded.tag or None)
    except SchemaError as error:
        return [FieldDifference("(all)", _short(str(error)), "", np.inf, np.inf)]
    lacking = {"header", *_lacking(schema, recorded.tag)}
    found = []
    for name, now in header.items():
        found += _field(f"header.{name}", getattr(then.header, name), now)
    for name in schema.model_fields:
        if name not in lacking:
            found += _field(name, getattr(then, name), getattr(message, name))
    if found or is_of_other_version(recorded):
        return found
    # The sign of a zero, for instance.
    return [FieldDifference("(bytes)", "equal numbers", "other bytes", 0.0, 0.0)]


def is_of_other_version(recorded: Recorded) -> bool:
    """Whether a message was sent by a version with another schema, so that bytes do not compare."""
    schema: type[Message] = recorded.topic.schema
    return recorded.tag not in {"", schema_tag(schema)}


def _lacking(schema: type[Message], tag: str) -> set[str]:
    """Return the fields that a message of another version lacks, or whose parts it lacks."""
    missing = compatibility(schema, tag).missing if tag else ()
    return {path.partition(".")[0] for path in missing}


def _field(name: str, then: Any, now: Any) -> list[FieldDifference]:
    if isinstance(then, np.ndarray) and isinstance(now, np.ndarray) and then.shape == now.shape:
        return _array(name, then, now)
    if isinstance(then, float) and isinstance(now, float):
        if then == now:
            return []
        delta = abs(now - then)
        return [FieldDifference(name, repr(then), repr(now), delta, delta / max(1.0, abs(then)))]
    # Arrays come here only with another shape.
    if not isinstance(then, np.ndarray) and then == now:
        return []
    return [FieldDifference(name, _short(repr(then)), _short(repr(now)), np.inf, np.inf)]


def _array(name: str, then: Any, now: Any) -> list[FieldDifference]:
    # NaN is as far off as can be.
    delta = np.nan_to_num(np.abs(now - then), nan=np.inf, posinf=np.inf)
    if not delta.any():
        return []
    index = tuple(int(i) for i in np.unravel_index(int(np.argmax(delta)), delta.shape))
    largest = float(delta[index])
    relative = largest / max(1.0, float(np.abs(then).max()))
    place = f"{name}[{', '.join(map(str, index))}]"
    values = repr(float(then[index])), repr(float(now[index]))
    return [FieldDifference(place, *values, largest, relative)]


def _short(text: str) -> str:
    return text if len(text) <= _SHOWN else f"{text[:_SHOWN]}…"
