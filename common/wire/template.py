"""Read a message that differs from an earlier one only in its counts and arrays.

Most messages of a publisher are like its last one but for the counts and times in the header and
the numbers in the arrays. A message that was decoded and found good therefore serves as a template:
its bytes with holes in these places. One operation takes another message apart, one comparison
shows that everything around the holes has been checked before, and only what is in the holes is
checked again. That is a third of the work of reading the message as if nothing were known.
"""

import struct
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import msgpack

from common.errors import SchemaError
from common.schemas import Header, Message
from common.wire.arrays import ArrayLayout, checked_views
from common.wire.builder import assembler

_PLAIN = (bool, int, float, str)
"""Types of the values that messages may share: nobody can change them."""
_COUNTS = {0xCC: "B", 0xCD: "H", 0xCE: "I", 0xCF: "Q"}
"""Layout of an unsigned number by the byte in front of it; smaller ones have no such byte."""
_END = 2**63
"""Counts are below it."""

_assemble_header = assembler(Header)


@dataclass(frozen=True)
class Template:
    """A good message, to read others by.

    Attributes:
        size: of the message [bytes].
        unpack: takes it apart into bytes around the holes and, in between, what is in these.
        around: the bytes around the holes.
        counts: fields of the header that have a hole.
        header: values of all its fields.
        values: of all fields of the message, in the order of the schema.
        arrays: its array fields; their holes follow those of the counts.
        assemble: makes a message from checked values.
    """

    size: int
    unpack: Callable[[bytes], tuple[Any, ...]]
    around: tuple[bytes, ...]
    counts: tuple[str, ...]
    header: dict[str, Any]
    values: dict[str, Any]
    arrays: ArrayLayout
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
        split = len(self.counts)
        counts = holes[:split]
        if max(counts, default=0) >= _END:
            return None
        header = dict(self.header)
        header.update(zip(self.counts, counts, strict=True))
        if injected_ns:
            header["injected"] = injected_ns
        values = dict(self.values)
        values["header"] = _assemble_header(header)
        try:
            views = checked_views(b"".join(holes[split:]), self.arrays)
        except SchemaError:
            return None
        values.update(zip(self.arrays.specs, views, strict=True))
        return self.assemble(values)


def template_of(payload: bytes, message: Message, arrays: ArrayLayout) -> Template | None:
    """Make a template of a message and the bytes that it was decoded from.

    Returns:
        None if it has no arrays, or parts that can be changed, or if the bytes are not exactly what
        :func:`common.wire.codec.encode` makes of it.
    """
    values = message.__dict__
    others = [value for name, value in values.items() if name not in arrays.specs]
    if not arrays.specs or not all(isinstance(value, _PLAIN) for value in others[1:]):
        return None
    pack = msgpack.Packer().pack
    # Before it is received nothing has been injected.
    header = {**message.header.__dict__, "injected": 0}
    layout, around, run = ">", [], bytearray()

    def hole(kind: str) -> None:
        nonlocal layout
        layout += f"{len(run)}s{kind}"
        around.append(bytes(run))
        run.clear()

    counts = []
    run += msgpack.Packer().pack_map_header(len(values)) + pack("header")
    run += msgpack.Packer().pack_map_header(len(header))
    for name, value in header.items():
        packed = pack(value)
        run += pack(name)
        if isinstance(value, int) and packed[0] in _COUNTS:
            run += packed[:1]
            hole(_COUNTS[packed[0]])
            counts.append(name)
        else:
            run += packed
    sizes = dict(zip(arrays.specs, arrays.sizes, strict=True))
    for name in list(values)[1:]:
        run += pack(name)
        if name in sizes:
            run += pack(bytes(sizes[name]))[: -sizes[name]]
            hole(f"{sizes[name]}s")
        else:
            run += pack(values[name])
    layout += f"{len(run)}s"
    form = struct.Struct(layout)
    around.append(bytes(run))
    if form.size != len(payload) or form.unpack(payload)[::2] != tuple(around):
        return None
    return Template(
        size=form.size,
        unpack=form.unpack,
        around=tuple(around),
        counts=tuple(counts),
        header=header,
        values=dict(values),
        arrays=arrays,
        assemble=assembler(type(message)),
    )
