"""Turns the fields of Pydantic models into rows of a Markdown table."""

import inspect
import re
import types
from collections.abc import Iterable, Iterator
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, Union, get_args, get_origin

from annotated_types import Ge, Gt, Le, Len, Lt, MaxLen
from pydantic import BaseModel, StringConstraints
from pydantic.fields import FieldInfo

from common.schemas.arrays import ArraySpec

Model = type[BaseModel]

_SCALARS: dict[object, str] = {
    bool: "true or false",
    int: "integer",
    float: "number",
    str: "string",
    bytes: "bytes",
    Path: "path",
    Any: "anything",
}
_INLINE_FIELDS = 3
"""A model with no more fields than this is shown as an inline table."""
_ENTRY = re.compile(r"^(?P<indent> +)(?P<names>[\w, ]+): (?P<text>.+)$")


def summary_of(model: Model) -> str:
    """Return the first paragraph of a model's docstring as one line."""
    return _markdown(" ".join(inspect.cleandoc(model.__doc__ or "").split("\n\n")[0].split()))


def details_of(model: Model) -> str:
    """Return the docstring's further paragraphs, without its ``Attributes`` section."""
    paragraphs = inspect.cleandoc(model.__doc__ or "").split("\n\n")[1:]
    kept = [p for p in paragraphs if not re.match(r"(Args|Attributes|Raises):", p)]
    return _markdown("\n\n".join(kept))


def _markdown(text: str) -> str:
    """Return a docstring's reStructuredText marks as Markdown."""
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", text.replace("``", "`"))


def documented(model: Model) -> dict[str, str]:
    """Return what the ``Args`` or ``Attributes`` section of a docstring says about each field."""
    found: dict[str, str] = {}
    current: list[str] = []
    within = False
    for line in inspect.cleandoc(model.__doc__ or "").splitlines():
        if line.strip() in {"Args:", "Attributes:"}:
            within = True
        elif within and line and not line.startswith(" "):
            within = False
        elif within and (match := _ENTRY.match(line)) and len(match["indent"]) == 4:
            current = [name.strip() for name in match["names"].split(",")]
            found |= dict.fromkeys(current, match["text"])
        elif within and line.strip():
            for name in current:
                found[name] += f" {line.strip()}"
    return found


def description_of(model: Model, name: str) -> str:
    """Return the description of a field, or what a docstring says: its class's, its type's."""
    field = model.model_fields[name]
    text = field.description or documented(model).get(name, "")
    kind = field.annotation
    if not text and isinstance(kind, type) and issubclass(kind, BaseModel):
        # A small table shows its keys in the default.
        text = summary_of(kind) if len(kind.model_fields) > _INLINE_FIELDS else ""
    if not text and len(get_args(field.annotation)) == 1 and not field.is_required():
        text = "always this"
    # TOML has no null: what is None in the code is absent in the file.
    return re.sub(r"\bNone\b", "absent", " ".join(text.split()))


def nested_models(annotation: object) -> Iterator[Model]:
    """Yield every model that occurs in a type annotation."""
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
        return
    for part in get_args(annotation):
        yield from nested_models(part)


def type_text(annotation: object, metadata: Iterable[object] = ()) -> str:
    """Return a type and its bounds in words, e.g. ``number > 0``.

    Args:
        annotation: the type.
        metadata: the annotations beside it.

    Raises:
        TypeError: a kind of type that the configuration has not had so far.
    """
    metadata = list(metadata)
    array = next((entry for entry in metadata if isinstance(entry, ArraySpec)), None)
    if array is not None:
        shape = " × ".join(str(length) for length in array.shape)
        return f"{shape} numbers" + (" (unit quaternion w, x, y, z)" if array.unit else "")
    return _plain_type(annotation) + _bounds(metadata)


def _plain_type(annotation: object) -> str:
    origin, arguments = get_origin(annotation), get_args(annotation)
    if origin is None:
        return _named_type(annotation)
    if origin is Annotated:
        return type_text(arguments[0], arguments[1:])
    if origin is Literal:
        return _choices(str(value) for value in arguments)
    if origin in {Union, types.UnionType}:
        return " or ".join(type_text(part) for part in arguments if part is not type(None))
    if origin in {tuple, list}:
        return _sequence(arguments)
    return "table" if arguments[1] is Any else f"table of {type_text(arguments[1])}"


def _named_type(annotation: object) -> str:
    if annotation in _SCALARS:
        return _SCALARS[annotation]
    if isinstance(annotation, type):
        if issubclass(annotation, Enum):
            return _choices(_enum_text(member) for member in annotation)
        if issubclass(annotation, BaseModel):
            return f"[{annotation.__name__}](#{annotation.__name__.lower()})"
    raise TypeError(f"no words for the type {annotation!r}")


def _sequence(arguments: tuple[Any, ...]) -> str:
    repeated = len(arguments) == 1 or arguments[-1] is Ellipsis
    inner = type_text(arguments[0])
    return f"list of {inner}" if repeated else f"{len(arguments)} × {inner}"


def _choices(values: Iterable[str]) -> str:
    return ", ".join(f"`{value}`" for value in values)


def _enum_text(member: Enum) -> str:
    return str(member.value) if isinstance(member.value, str) else member.name


def _bounds(metadata: Iterable[object]) -> str:
    low = high = pattern = length = ""
    for entry in metadata:
        match entry:
            case Ge(ge):
                low = f"≥ {_number(ge)}"
            case Gt(gt):
                low = f"> {_number(gt)}"
            case Le(le):
                high = f"≤ {_number(le)}"
            case Lt(lt):
                high = f"< {_number(lt)}"
            case MaxLen(most) | Len(0, most):
                length = f"at most {most} long"
            case StringConstraints():
                pattern = f"`{entry.pattern}`" if entry.pattern else ""
                length = f"at most {entry.max_length} long" if entry.max_length else length
            case FieldInfo():
                return _bounds(entry.metadata)
    parts = [part for part in (low, high, pattern, length) if part]
    return f" {', '.join(parts)}" if parts else ""


def _number(value: Any) -> str:
    return "2^63" if value == 2**63 else f"{value:.12g}"


def value_text(value: object) -> str:
    """Return a default as TOML writes it; empty for None, which TOML cannot say."""
    if value is None or isinstance(value, BaseModel):
        return "" if value is None else _inline_table(value)
    if isinstance(value, tuple | list):
        return f"[{', '.join(value_text(item) for item in value)}]"
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return f"{value:.1f}" if value == int(value) else f"{value:.6g}"
    if isinstance(value, str):
        return f'"{_enum_text(value) if isinstance(value, Enum) else value}"'
    return str(value)


def _inline_table(value: BaseModel) -> str:
    fields = type(value).model_fields
    if len(fields) > _INLINE_FIELDS:
        return ""
    pairs = (f"{name} = {value_text(getattr(value, name))}" for name in fields)
    return f"{{ {', '.join(pairs)} }}"


def rows(model: Model) -> list[str]:
    """Return a Markdown table row for each field: key, type, default, description."""
    result = []
    for name, field in model.model_fields.items():
        if field.is_required():
            default = "required"
        else:
            text = value_text(field.get_default(call_default_factory=True))
            default = f"`{text}`" if text else ""
        kind = type_text(field.annotation, field.metadata)
        cells = (f"`{name}`", kind, default, description_of(model, name))
        result.append("| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |")
    return result


def table(model: Model) -> str:
    """Return the Markdown table of a model's fields."""
    head = ["| key | type | default | meaning |", "|---|---|---|---|"]
    return "\n".join([*head, *rows(model)])
