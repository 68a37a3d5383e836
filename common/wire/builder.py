"""Build a message from a map of fields whose arrays have been checked already.

Pydantic's own validation of a model would check every array a second time, one by one, which is
most of the cost of a state message. So the other fields are validated as those of a typed
dictionary, and the model is made from the result.
"""

from collections.abc import Callable
from functools import cache
from typing import Annotated, Any, TypeVar, cast

from pydantic import BaseModel, TypeAdapter
from typing_extensions import TypedDict

from common.schemas import Message
from common.wire.schema import array_spec

B = TypeVar("B", bound=BaseModel)

SLOTS = ("__dict__", "__pydantic_fields_set__", "__pydantic_extra__", "__pydantic_private__")
"""What every model consists of."""
_set_values, _set_fields_set, _set_extra, _set_private = (
    BaseModel.__dict__[slot].__set__ for slot in SLOTS
)
"""Setters of these, which a frozen model refuses to set by name."""


def message_builder(schema: type[Message]) -> Callable[[dict[str, Any]], Message]:
    """Return a function that validates a map with all fields of ``schema`` and builds the message.

    A schema with validators of its own is built by its own validation. The function returned
    raises :class:`pydantic.ValidationError`.
    """
    if has_validators(schema):
        return schema.model_validate
    validate, assemble = fields_validator(schema, tuple(schema.model_fields)), assembler(schema)
    return lambda fields: assemble(validate(fields))


def has_validators(schema: type[Message]) -> bool:
    """Whether a schema has validators of its own."""
    decorators = schema.__pydantic_decorators__
    return bool(decorators.model_validators or decorators.field_validators)


@cache
def assembler(model: type[B]) -> Callable[[dict[str, Any]], B]:
    """Return a function that makes a ``model`` of the checked values of all its fields."""
    # Messages are frozen, so they can share it.
    fields_set = set(model.model_fields)
    new = object.__new__

    def assemble(values: dict[str, Any]) -> B:
        made = new(model)
        _set_values(made, values)
        _set_fields_set(made, fields_set)
        _set_extra(made, None)
        _set_private(made, None)
        return made

    return assemble


@cache
def fields_validator(
    schema: type[Message], names: tuple[str, ...]
) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function that validates some fields of ``schema``, arrays taken as they are."""
    types: dict[str, Any] = {}
    for name in names:
        field = schema.model_fields[name]
        if array_spec(field.metadata) is not None:
            types[name] = Any
        elif field.metadata:
            types[name] = Annotated[(field.annotation, *field.metadata)]
        else:
            types[name] = field.annotation
    dictionary = cast(Any, TypedDict)(schema.__name__, types)
    # Which fields there are is checked before, and faster.
    dictionary.__pydantic_config__ = {
        key: value for key, value in schema.model_config.items() if key != "extra"
    }
    adapter: TypeAdapter[dict[str, Any]] = TypeAdapter(dictionary)
    return adapter.validate_python
