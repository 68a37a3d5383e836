"""Any message of ours as protobuf, field by field: for raw views and for plots.

The protobuf type ``trill.<Schema>`` is derived from the Pydantic model, so a topic added to the
table is exported without a line here. Arrays become repeated doubles (a quaternion stays w, x, y,
z), enumerations keep their names, nested models become nested messages.
"""

from collections.abc import Callable
from enum import IntEnum
from functools import cache
from typing import Any, Literal, get_args, get_origin

import numpy as np
from google.protobuf.descriptor_pb2 import (
    DescriptorProto,
    FieldDescriptorProto,
    FileDescriptorProto,
)
from google.protobuf.descriptor_pool import DescriptorPool
from google.protobuf.message import Message as Protobuf
from google.protobuf.message_factory import GetMessageClass
from pydantic import BaseModel

from services.logger.export.errors import ExportError

PACKAGE = "trill"

_Fill = Callable[[Any, Any], None]
_SCALARS: dict[type, Any] = {
    float: FieldDescriptorProto.TYPE_DOUBLE,
    int: FieldDescriptorProto.TYPE_INT64,
    bool: FieldDescriptorProto.TYPE_BOOL,
    str: FieldDescriptorProto.TYPE_STRING,
    bytes: FieldDescriptorProto.TYPE_BYTES,
}
_ENUM = "Value"
"""Enumerators are siblings of their type in protobuf, so each type gets a scope of its own."""


def to_protobuf(message: BaseModel) -> Protobuf:
    """``message`` with all its fields.

    Raises:
        ExportError: a field has a type that has no counterpart.
    """
    result = message_class(type(message))()
    _filler(type(message))(result, message)
    return result


@cache
def message_class(model: type[BaseModel]) -> type[Protobuf]:
    """The protobuf class of a model, ``trill.<name>``, with all it contains nested in it.

    Raises:
        ExportError: a field has a type that has no counterpart.
    """
    file = FileDescriptorProto(
        name=f"{PACKAGE}/{model.__name__}.proto", package=PACKAGE, syntax="proto3"
    )
    _describe(file.message_type.add(name=model.__name__), model, f".{PACKAGE}.{model.__name__}")
    pool = DescriptorPool()
    pool.Add(file)  # type: ignore[no-untyped-call,unused-ignore]
    kind: type[Protobuf] = GetMessageClass(
        pool.FindMessageTypeByName(f"{PACKAGE}.{model.__name__}")
    )
    return kind


def _describe(into: DescriptorProto, model: type[BaseModel], scope: str) -> None:
    for number, (name, info) in enumerate(model.model_fields.items(), start=1):
        kind, repeated = _kind(info.annotation, f"{model.__name__}.{name}")
        label = (
            FieldDescriptorProto.LABEL_REPEATED if repeated else FieldDescriptorProto.LABEL_OPTIONAL
        )
        field = into.field.add(name=name, number=number, label=label)
        if kind in _SCALARS:
            field.type = _SCALARS[kind]
        elif issubclass(kind, IntEnum):
            field.type = FieldDescriptorProto.TYPE_ENUM
            field.type_name = f"{scope}.{kind.__name__}.{_ENUM}"
            _describe_enum(into, kind, f"{model.__name__}.{name}")
        else:
            field.type = FieldDescriptorProto.TYPE_MESSAGE
            nested = kind.__name__.lstrip("_")
            field.type_name = f"{scope}.{nested}"
            if all(one.name != nested for one in into.nested_type):
                _describe(into.nested_type.add(name=nested), kind, field.type_name)


def _describe_enum(into: DescriptorProto, kind: type[IntEnum], where: str) -> None:
    if all(member.value != 0 for member in kind):
        raise ExportError(f"cannot export {where}: {kind.__name__} has no member for 0")
    if any(one.name == kind.__name__ for one in into.nested_type):
        return
    values = into.nested_type.add(name=kind.__name__).enum_type.add(name=_ENUM).value
    # Protobuf wants the enumerator that stands for 0 first.
    for member in sorted(kind, key=lambda member: member.value):
        values.add(name=member.name, number=member.value)


def _kind(annotation: Any, where: str) -> tuple[Any, bool]:
    """The element type of a field and whether there are several of it."""
    if annotation is not None and get_origin(annotation) is list:
        return _kind(get_args(annotation)[0], where)[0], True
    if get_origin(annotation) is np.ndarray:
        return float, True
    if get_origin(annotation) is Literal and all(isinstance(a, str) for a in get_args(annotation)):
        return str, False
    if isinstance(annotation, type) and issubclass(annotation, (*_SCALARS, BaseModel)):
        enum = issubclass(annotation, IntEnum)
        base = next((one for one in (bool, *_SCALARS) if issubclass(annotation, one)), annotation)
        return (annotation if enum else base), False
    raise ExportError(
        f"cannot export {where}: expected a number, text, bytes, enumeration, array, model or list "
        f"of these, got {annotation}; give it a counterpart in {__name__}"
    )


@cache
def _filler(model: type[BaseModel]) -> _Fill:
    """A function that copies a message's values into its protobuf, worked out once per type."""
    fills = [
        _field_filler(name, *_kind(info.annotation, f"{model.__name__}.{name}"))
        for name, info in model.model_fields.items()
    ]

    def fill(target: Any, message: Any) -> None:
        for one in fills:
            one(target, message)

    return fill


def _field_filler(name: str, kind: Any, repeated: bool) -> _Fill:
    if issubclass(kind, BaseModel):
        inner = _filler(kind)
        if not repeated:
            return lambda target, message: inner(getattr(target, name), getattr(message, name))

        def fill_each(target: Any, message: Any) -> None:
            field = getattr(target, name)
            for item in getattr(message, name):
                inner(field.add(), item)

        return fill_each
    if repeated:

        def extend(target: Any, message: Any) -> None:
            values = getattr(message, name)
            flat = values.ravel().tolist() if isinstance(values, np.ndarray) else values
            getattr(target, name).extend(flat)

        return extend
    return lambda target, message: setattr(target, name, getattr(message, name))
