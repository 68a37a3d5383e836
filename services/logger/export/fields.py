"""Converts any message to protobuf, field by field, for raw views and plots.

The protobuf type ``trill.<Schema>`` is derived from the Pydantic model, so a topic added to the
table is exported without a line here. Arrays become repeated doubles (a quaternion stays w, x, y,
z), enumerations keep their names, nested models become nested messages. Protobuf and not JSON,
because Rerun plots numbers of protobuf channels but takes JSON channels for opaque bytes.
"""

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

from services.logger.errors import ExportError

PACKAGE = "trill"

_SCALARS: dict[type, Any] = {
    bool: FieldDescriptorProto.TYPE_BOOL,
    float: FieldDescriptorProto.TYPE_DOUBLE,
    int: FieldDescriptorProto.TYPE_INT64,
    str: FieldDescriptorProto.TYPE_STRING,
    bytes: FieldDescriptorProto.TYPE_BYTES,
}
"""Protobuf type of each scalar; ``bool`` stands first, because it is an ``int`` too."""
_ENUM = "Value"
"""Enumerators are siblings of their type in protobuf, so each type gets a scope of its own."""


def to_protobuf(message: BaseModel) -> Protobuf:
    """Return ``message`` as protobuf with all its fields.

    Raises:
        ExportError: a field has a type without a counterpart in protobuf.
    """
    return message_class(type(message))(**_plain(message))


@cache
def message_class(model: type[BaseModel]) -> type[Protobuf]:
    """Return the protobuf class ``trill.<name>`` of a model, with all it contains nested in it.

    Raises:
        ExportError: a field has a type without a counterpart in protobuf.
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


def _plain(value: Any) -> Any:
    """Return a value as what protobuf's constructors take: dictionaries, lists and scalars."""
    if isinstance(value, BaseModel):
        return {name: _plain(getattr(value, name)) for name in type(value).model_fields}
    if isinstance(value, np.ndarray):
        return value.ravel().tolist()
    if isinstance(value, list):
        return [_plain(one) for one in value]
    return value


def _describe(into: DescriptorProto, model: type[BaseModel], scope: str) -> None:
    """Add the fields of ``model`` to the message type ``into``, whose full name is ``scope``."""
    for number, (name, info) in enumerate(model.model_fields.items(), start=1):
        where = f"{model.__name__}.{name}"
        kind, repeated = _kind(info.annotation, where)
        label = (
            FieldDescriptorProto.LABEL_REPEATED if repeated else FieldDescriptorProto.LABEL_OPTIONAL
        )
        field = into.field.add(name=name, number=number, label=label)
        if kind in _SCALARS:
            field.type = _SCALARS[kind]
        elif issubclass(kind, IntEnum):
            field.type = FieldDescriptorProto.TYPE_ENUM
            field.type_name = f"{scope}.{kind.__name__}.{_ENUM}"
            _describe_enum(into, kind, where)
        else:
            nested = kind.__name__.lstrip("_")
            field.type = FieldDescriptorProto.TYPE_MESSAGE
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
    """Return the element type of a field and whether the field is repeated."""
    origin = get_origin(annotation)
    if origin is list:
        return _kind(get_args(annotation)[0], where)[0], True
    if origin is np.ndarray:
        return float, True
    if origin is Literal and all(isinstance(one, str) for one in get_args(annotation)):
        return str, False
    if isinstance(annotation, type):
        if issubclass(annotation, (IntEnum, BaseModel)):
            return annotation, False
        for scalar in _SCALARS:
            if issubclass(annotation, scalar):
                return scalar, False
    raise ExportError(
        f"cannot export {where}: expected a number, text, bytes, enumeration, array, model or list "
        f"of these, got {annotation}; give it a counterpart in {__name__}"
    )
