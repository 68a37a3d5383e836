"""Check all arrays of a message at once, as views on one block.

They are joined to one block whose finiteness is one operation, which takes a fraction of the time
of checking them one by one.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import accumulate
from operator import itemgetter
from typing import Any

import numpy as np

from common.errors import SchemaError
from common.schemas import Message
from common.schemas.arrays import UNIT_TOLERANCE, ArraySpec, Float64Array
from common.wire.schema import array_spec


@dataclass(frozen=True)
class ArrayLayout:
    """The array fields of a schema and their places in the joined block.

    Attributes:
        specs: shape of each, by field name, in the order of the block.
        sizes: of each [bytes].
        pieces_of: returns the arrays' values from a map.
        views_of: returns the arrays' views on the block.
        shaped: name and shape of those with more than one dimension.
        units: names of those that are unit vectors.
    """

    specs: dict[str, ArraySpec]
    sizes: tuple[int, ...]
    pieces_of: Callable[[Any], tuple[Any, ...]]
    views_of: Callable[[Any], tuple[Float64Array, ...]]
    shaped: tuple[tuple[str, tuple[int, ...]], ...]
    units: tuple[str, ...]


def array_layout(schema: type[Message]) -> ArrayLayout:
    """Lay the array fields of ``schema`` out in one block, in the order of declaration."""
    found = ((name, array_spec(field.metadata)) for name, field in schema.model_fields.items())
    specs = {name: spec for name, spec in found if spec is not None}
    counts = [math.prod(spec.shape) for spec in specs.values()]
    stops = list(accumulate(counts))
    return ArrayLayout(
        specs=specs,
        sizes=tuple(8 * count for count in counts),
        pieces_of=_getter(list(specs)),
        views_of=_getter([slice(b - n, b) for b, n in zip(stops, counts, strict=True)]),
        shaped=tuple((name, spec.shape) for name, spec in specs.items() if len(spec.shape) != 1),
        units=tuple(name for name, spec in specs.items() if spec.unit),
    )


def view_arrays(fields: dict[str, Any], layout: ArrayLayout) -> bool:
    """Replace the bytes of the array fields by checked read-only views, in place.

    Args:
        fields: a message as a map; it has all array fields.
        layout: of its schema.

    Returns:
        False, with nothing replaced, if a field is not bytes of the right size.

    Raises:
        SchemaError: an array holds NaN or infinity, or a quaternion is not of unit length.
    """
    pieces = layout.pieces_of(fields)
    try:
        if tuple(map(len, pieces)) != layout.sizes:
            return False
        block = np.frombuffer(b"".join(pieces), dtype="<f8")
    except TypeError:  # a number has no length, and text does not join with bytes
        return False
    fields.update(zip(layout.specs, layout.views_of(block), strict=True))
    # Looking for a False among the mask's bytes takes a third of the time of `all`.
    if b"\0" in np.isfinite(block).tobytes():
        wrong = ", ".join(name for name in layout.specs if not np.isfinite(fields[name]).all())
        raise SchemaError(f"{wrong}: expected finite numbers, got NaN or infinity")
    for name in layout.units:
        norm = math.hypot(*fields[name].tolist())
        if abs(norm - 1.0) > UNIT_TOLERANCE:
            raise SchemaError(
                f"{name}: expected a unit quaternion (w, x, y, z), got norm {norm:.6g}"
            )
    for name, shape in layout.shaped:
        fields[name] = fields[name].reshape(shape)
    return True


def _getter(keys: Sequence[Any]) -> Callable[[Any], tuple[Any, ...]]:
    """Return an :class:`operator.itemgetter` that returns a tuple for any number of keys."""
    if len(keys) > 1:
        return itemgetter(*keys)
    return lambda source: tuple(source[key] for key in keys)
