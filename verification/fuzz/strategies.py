"""Hypothesis strategies derived from the message schemas, and corpora of valid messages."""

from collections.abc import Sequence
from typing import Annotated, Any, TypeVar, get_args, get_origin

import numpy as np
from hypothesis import HealthCheck, Phase, given, reject, settings
from hypothesis import seed as with_seed
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydantic import BaseModel, ValidationError

from common.schemas import Message
from common.wire.schema import array_spec

B = TypeVar("B", bound=BaseModel)
M = TypeVar("M", bound=Message)

_WIDEST = 1e6
"""Largest element of an array."""
_SHORTEST = 1e-3
"""Length of the shortest vector that is made a unit vector."""
_MOST_ITEMS = 3


def models(schema: type[B]) -> st.SearchStrategy[B]:
    """Return a strategy for valid instances of a schema, every field included."""
    fields = {
        name: _values(field.annotation, field.metadata)
        for name, field in schema.model_fields.items()
    }

    def validated(values: dict[str, Any]) -> B:
        try:
            return schema.model_validate(values)
        except ValidationError:  # of a bound that the types do not tell, such as a vector's length
            reject()

    return st.fixed_dictionaries(fields).map(validated)


def _values(annotation: Any, metadata: Sequence[Any] = ()) -> st.SearchStrategy[Any]:
    spec = array_spec(metadata)
    if spec is not None:
        found = arrays(np.float64, spec.shape, elements=st.floats(-_WIDEST, _WIDEST))
        if spec.unit:
            found = found.filter(lambda array: np.linalg.norm(array) > _SHORTEST)
            found = found.map(lambda array: array / np.linalg.norm(array))
        return found
    if get_origin(annotation) is Annotated:
        inner, *more = get_args(annotation)
        return _values(inner, [*metadata, *more])
    if get_origin(annotation) is list:
        return st.lists(_values(get_args(annotation)[0]), max_size=_MOST_ITEMS)
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return models(annotation)
    limited: Any = Annotated[annotation, *metadata] if metadata else annotation
    found = st.from_type(limited)
    if annotation is float:
        return found.filter(np.isfinite)
    # The wire has no larger integers.
    return found.filter(lambda value: abs(value) < 2**63) if annotation is int else found


def corpus(schema: type[M], count: int, seed: int) -> list[M]:
    """Return valid messages of a schema; the same seed gives the same ones."""
    found: list[M] = []

    @with_seed(seed)
    @settings(
        max_examples=count,
        database=None,
        deadline=None,
        phases=[Phase.generate],
        suppress_health_check=list(HealthCheck),
    )
    @given(models(schema))
    def collect(message: M) -> None:
        found.append(message)

    collect()
    return found
