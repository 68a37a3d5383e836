"""Random good messages of any schema, to damage."""

import random
import string
from enum import Enum
from typing import Annotated, Any, Literal, get_args, get_origin

import numpy as np
from annotated_types import Ge, Gt, Le, Lt, MaxLen
from pydantic import BaseModel
from pydantic.fields import FieldInfo

from common.errors import SchemaError
from common.schemas import Header, Message
from common.wire.schema import array_spec

_MOST_ITEMS = 3
_MOST_BYTES = 200
_WIDE = 1e6


def random_message(schema: type[Message], rng: random.Random, seq: int) -> Message:
    """Return a good message with random fields and sequence number ``seq``.

    Raises:
        SchemaError: a field has a type this does not know.
    """
    header = Header(
        seq=seq,
        stamp=rng.randrange(2**40),
        sent=rng.randrange(2**40),
        boot=1,
        source="fuzz",
    )
    fields = {name: _value(field) for name, field in _fields(schema, rng) if name != "header"}
    return schema.model_validate({**fields, "header": header})


class _Field:
    """What is to be drawn: a type with its limits."""

    def __init__(self, annotation: Any, metadata: list[Any], rng: random.Random) -> None:
        self.annotation = annotation
        self.metadata = metadata
        self.rng = rng


def _fields(model: type[BaseModel], rng: random.Random) -> list[tuple[str, _Field]]:
    def described(field: FieldInfo) -> _Field:
        return _Field(field.annotation, list(field.metadata), rng)

    return [(name, described(field)) for name, field in model.model_fields.items()]


def _value(field: _Field) -> Any:
    """Draw one value."""
    rng, kind = field.rng, field.annotation
    spec = array_spec(field.metadata)
    if spec is not None:
        array = np.array([rng.gauss(0.0, 1.0) for _ in range(int(np.prod(spec.shape)))])
        if spec.unit:
            array /= np.linalg.norm(array)
        return array.reshape(spec.shape)
    if get_args(kind):
        return _generic(kind, field)
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return kind.model_validate({name: _value(inner) for name, inner in _fields(kind, rng)})
    if isinstance(kind, type) and issubclass(kind, Enum):
        return rng.choice(list(kind))
    return _scalar(kind, field)


def _generic(kind: Any, field: _Field) -> Any:
    """Draw a value of a type with arguments."""
    rng, origin, arguments = field.rng, get_origin(kind), get_args(kind)
    if origin is Annotated:
        return _value(_Field(arguments[0], [*field.metadata, *arguments[1:]], rng))
    if origin is Literal:
        return rng.choice(arguments)
    if origin is list:
        inner = _Field(arguments[0], [], rng)
        return [_value(inner) for _ in range(rng.randrange(_MOST_ITEMS + 1))]
    raise SchemaError(f"cannot make up a value of {kind}; teach verification/fuzz/messages.py")


def _scalar(kind: type[Any], field: _Field) -> Any:
    rng = field.rng
    if issubclass(kind, bool):
        return rng.random() < 0.5
    if issubclass(kind, int):
        low, high = _limits(field.metadata, -1e6)
        return rng.randint(round(low), round(high))
    if issubclass(kind, float):
        low, high = _limits(field.metadata, -_WIDE)
        return rng.uniform(low, high)
    length = min([_MOST_BYTES, *(m.max_length for m in field.metadata if isinstance(m, MaxLen))])
    if issubclass(kind, bytes):
        return rng.randbytes(rng.randrange(length + 1))
    if issubclass(kind, str):
        letters = string.ascii_letters + "äß⚠"
        return "".join(rng.choice(letters) for _ in range(rng.randrange(min(length, 20) + 1)))
    raise SchemaError(f"cannot make up a value of {kind}; teach verification/fuzz/messages.py")


def _limits(metadata: list[Any], low: float) -> tuple[float, float]:
    """Return an interval in which all limits hold."""
    high = _WIDE
    for limit in metadata:
        if isinstance(limit, Ge):
            low = max(low, float(limit.ge))  # type: ignore[arg-type]
        elif isinstance(limit, Gt):
            low = max(low, float(limit.gt) + 1e-3)  # type: ignore[arg-type]
        elif isinstance(limit, Le):
            high = min(high, float(limit.le))  # type: ignore[arg-type]
        elif isinstance(limit, Lt):
            high = min(high, float(limit.lt) - 1e-3)  # type: ignore[arg-type]
    return low, high
