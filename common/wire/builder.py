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


def message_builder(schema: type[Message]) -> Callable[[dict[str, Any]], Message]:
    """Return a function that validates a map with all fields of ``schema`` and builds the message.

    A schema with validators of its own is built by its own validation. The function returned
    raises :class:`pydantic.ValidationError`.
    """
    decorators = schema.__pydantic_decorators__
    if decorators.model_validators or decorators.field_validators:
        return schema.model_validate
    validate, assemble = _fields_validator(schema), assembler(schema)
    return lambda fields: assemble(validate(fields))


@cache
def assembler(model: type[B]) -> Callable[[dict[str, Any]], B]:
    """Return a function that makes a ``model`` of the checked values of all its fields."""
    # Messages are frozen, so they can share it.
    fields_set = set(model.model_fields)
    assign = object.__setattr__

    def assemble(values: dict[str, Any]) -> B:
        made = model.__new__(model)
        assign(made, "__dict__", values)
        assign(made, "__pydantic_fields_set__", fields_set)
        assign(made, "__pydantic_extra__", None)
        assign(made, "__pydantic_private__", None)
        return made

    return assemble


def _fields_validator(schema: type[Message]) -> Callable[[dict[str, Any]], dict[str, Any]]:
    """Return a function that validates the fields of ``schema``, arrays taken as they are."""
    types: dict[str, Any] = {}
    for name, field in schema.model_fields.items():
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
