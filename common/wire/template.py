"""Read a message that differs from an earlier one only in its counts and measurements.

Most messages of a publisher are like its last one but for the counts and times in the header and
the numbers in arrays and other fields. A message that was decoded and found good therefore serves
as a template: its bytes with holes in these places. One operation takes another message apart, one
comparison shows that everything around the holes has been checked before, and only what is in the
holes is checked again. That takes half the time of reading the message as if nothing were known.
"""

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import msgpack
import numpy as np
from pydantic import ValidationError

from common.errors import SchemaError
from common.native import kernel
from common.schemas import Header, Message
from common.schemas.arrays import UNIT_TOLERANCE
from common.wire.arrays import FLOAT64, ArrayLayout, checked_views, getter
from common.wire.builder import SLOTS, assembler, fields_validator

_PLAIN = (bool, int, float, str)
"""Types of the values that messages may share: nobody can change them."""
_COUNTS = {0xCC: "B", 0xCD: "H", 0xCE: "I", 0xCF: "Q"}
"""Layout of an unsigned number by the byte in front of it; smaller ones have no such byte."""
_END = 2**63
"""Counts are below it."""

_assemble_header = assembler(Header)
_template: Any = kernel("common.wire._template")

Reader = Callable[[bytes, int], Message | None]
"""Returns the message in a payload as :meth:`Template.read` does."""


@dataclass(frozen=True)
class Template:
    """A good message, to read others by.

    Attributes:
        schema: type of the message.
        unpack: takes it apart into bytes around the holes and, in between, what is in these.
        around: the bytes around the holes.
        holes: layout of each, for :mod:`struct`, and the field that it belongs to.
        counts: fields of the header that have a hole; theirs come first.
        numbers: other fields with a hole that are numbers.
        numbers_of: returns what is in their holes.
        check_numbers: validates them; None if there are none.
        header: values of all its fields.
        values: of all fields of the message, in the order of the schema.
        arrays: its array fields.
        pieces_of: returns what is in their holes.
        assemble: makes a message from checked values.
    """

    schema: type[Message]
    unpack: Callable[[bytes], tuple[Any, ...]]
    around: tuple[bytes, ...]
    holes: tuple[tuple[str, str], ...]
    counts: tuple[str, ...]
    numbers: tuple[str, ...]
    numbers_of: Callable[[Any], tuple[float, ...]]
    check_numbers: Callable[[dict[str, Any]], dict[str, Any]] | None
    header: dict[str, Any]
    values: dict[str, Any]
    arrays: ArrayLayout
    pieces_of: Callable[[Any], tuple[bytes, ...]]
    assemble: Callable[[dict[str, Any]], Message]

    def read(self, payload: bytes, injected_ns: int) -> Message | None:
        """Return the message in a payload of this size; None unless it is like this one and good.

        Args:
            payload: the bytes received.
            injected_ns: delay injected on the way [ns], noted in the header; 0 leaves it as it is.
        """
        parts = self.unpack(payload)
        if parts[::2] != self.around:
            return None
        holes = parts[1::2]
        header = dict(self.header)
        for name, count in zip(self.counts, holes, strict=False):
            if count >= _END:
                return None
            header[name] = count
        if injected_ns:
            header["injected"] = injected_ns
        values = dict(self.values)
        values["header"] = _assemble_header(header)
        try:
            if self.check_numbers is not None:
                numbers = dict(zip(self.numbers, self.numbers_of(holes), strict=True))
                values.update(self.check_numbers(numbers))
            views = checked_views(b"".join(self.pieces_of(holes)), self.arrays)
        except (SchemaError, ValidationError):
            return None
        for name, view in zip(self.arrays.specs, views, strict=True):
            values[name] = view
        return self.assemble(values)

    def reader(self) -> Reader:
        """Return :meth:`read`, as compiled code if there is any."""
        if _template is None:
            return self.read
        arrays, places, stop = [], {}, 0
        for name, spec in self.arrays.specs.items():
            start, stop = stop, stop + math.prod(spec.shape)
            shape = None if len(spec.shape) == 1 else spec.shape
            arrays.append((name, slice(start, stop), shape, stop - start, spec.unit))
            places[name] = 8 * start
        # Counts of the header come first; what is neither a float nor an array is an integer.
        kinds = "c" * len(self.counts) + "".join(
            hole[-1] if hole[-1] in "ds" else "n" for hole, _ in self.holes[len(self.counts) :]
        )
        prepared = _template.prepare(
            self.around,
            tuple(
                (kind, struct.calcsize(f">{hole}"), places.get(name, 0), name)
                for kind, (hole, name) in zip(kinds, self.holes, strict=True)
            ),
            tuple(arrays),
            (Header, set(Header.model_fields), self.header),
            (self.schema, set(self.schema.model_fields), self.values),
            self.check_numbers,
            ValidationError,
            np.frombuffer,
            FLOAT64,
            UNIT_TOLERANCE,
            ("header", "injected", "reshape"),
            SLOTS,
        )
        return partial(_template.read, prepared)

    def moves(self, name: str, value: object) -> bool:
        """Whether a field of another message is unlike this one's, or was of one before."""
        return name in self.numbers or self.values[name] != value


class _Outline:
    """A message's bytes with holes, as they are collected from its beginning."""

    def __init__(self) -> None:
        self.layout = ">"
        """Of what was collected, for :mod:`struct`."""
        self.around: list[bytes] = []
        self.holes: list[tuple[str, str]] = []
        """Layout and field of each."""
        self._run = b""

    def add(self, data: bytes) -> None:
        """Add bytes that stay the same."""
        self._run += data

    def end_run(self, hole: str = "", name: str = "") -> None:
        """Add the hole of a field, with this layout; or nothing, at the end of the message."""
        self.layout += f"{len(self._run)}s{hole}"
        self.around.append(self._run)
        if hole:
            self.holes.append((hole, name))
        self._run = b""


def _add_header(outline: _Outline, header: dict[str, Any], packer: Any) -> tuple[str, ...]:
    """Add a header; returns the fields that have a hole."""
    counts = []
    outline.add(packer.pack_map_header(len(header)))
    for name, value in header.items():
        packed = packer.pack(value)
        outline.add(packer.pack(name))
        if isinstance(value, int) and packed[0] in _COUNTS:
            outline.add(packed[:1])
            outline.end_run(_COUNTS[packed[0]], name)
            counts.append(name)
        else:
            outline.add(packed)
    return tuple(counts)


def _hole_of(value: object, packed: bytes, *, moves: bool) -> str:
    """Return the layout of a number's hole; empty for what must be the same in all messages."""
    if isinstance(value, float):
        return "d"
    # The members of an enumeration are integers too, but have to be looked up.
    return _COUNTS.get(packed[0], "") if moves and type(value) is int else ""


def template_of(
    payload: bytes, message: Message, arrays: ArrayLayout, before: Template | None = None
) -> Template | None:
    """Make a template of a message and the bytes that it was decoded from.

    Integers outside the header have a hole if they differ from those of the template ``before``;
    most of them never change, and what is in a hole has to be checked each time.

    Returns:
        None if it has parts that can be changed, or if the bytes are not exactly what
        :func:`common.wire.codec.encode` makes of it.
    """
    values = dict(message.__dict__)
    del values["header"]
    if not all(name in arrays.specs or isinstance(values[name], _PLAIN) for name in values):
        return None
    packer, outline = msgpack.Packer(), _Outline()
    # Before it is received nothing has been injected.
    header = {**message.header.__dict__, "injected": 0}
    outline.add(packer.pack_map_header(1 + len(values)) + packer.pack("header"))
    counts = _add_header(outline, header, packer)
    places: dict[str, int] = {}
    for name, value in values.items():
        is_array = name in arrays.specs
        packed = packer.pack(value.tobytes() if is_array else value)
        if is_array:
            hole = f"{value.nbytes}s"
        else:
            moves = before is not None and before.moves(name, value)
            hole = _hole_of(value, packed, moves=moves)
        size = struct.calcsize(f">{hole}")
        outline.add(packer.pack(name) + packed[: len(packed) - size])
        if hole:
            places[name] = len(outline.around)
            outline.end_run(hole, name)
    outline.end_run()
    numbers = tuple(name for name in places if name not in arrays.specs)
    form = struct.Struct(outline.layout)
    around = tuple(outline.around)
    if form.size != len(payload) or form.unpack(payload)[::2] != around:
        return None
    return Template(
        schema=type(message),
        unpack=form.unpack,
        around=around,
        holes=tuple(outline.holes),
        counts=counts,
        numbers=numbers,
        numbers_of=getter([places[name] for name in numbers]),
        check_numbers=fields_validator(type(message), numbers) if numbers else None,
        header=header,
        values=dict(message.__dict__),
        arrays=arrays,
        pieces_of=getter([places[name] for name in arrays.specs]),
        assemble=assembler(type(message)),
    )
