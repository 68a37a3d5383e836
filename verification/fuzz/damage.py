"""Functions that damage an encoded message."""

import math
import random
import struct
from collections.abc import Callable
from typing import Any

import msgpack

Damage = Callable[[bytes, random.Random], bytes]

_EDGE_VALUES: tuple[Any, ...] = (
    *(None, True, -1, 2**63, 2**64 - 1, -(2**63), math.nan, math.inf, -math.inf, 1e308),
    *("", "x" * 500, b"", b"\0" * 216, [], [[[]]], {}, {"header": {}}),
    struct.pack("<27d", *[math.nan] * 27),
    struct.pack("<3d", math.inf, 0.0, 0.0),
    struct.pack("<4d", 0.0, 0.0, 0.0, 0.0),
)
_HUGE_LENGTHS = (
    b"\xdd\xff\xff\xff\xff",
    b"\xdf\xff\xff\xff\xff",
    b"\xc6\xff\xff\xff\xff",
    b"\xc9\x7f",
)
"""Heads of an array, a map, bytes and an extension that are far longer than the payload."""
_CONTAINERS = (b"\x91", b"\x81\xa1a", b"\x81\xa6header")


def _random_bytes(_: bytes, rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(400))


def _flip_bits(payload: bytes, rng: random.Random) -> bytes:
    data = bytearray(payload)
    for _ in range(rng.randint(1, 6)):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def _overwrite(payload: bytes, rng: random.Random) -> bytes:
    start, piece = rng.randrange(len(payload)), rng.randbytes(rng.randint(1, 16))
    return payload[:start] + piece + payload[start + len(piece) :]


def _truncate(payload: bytes, rng: random.Random) -> bytes:
    return payload[: rng.randrange(len(payload))]


def _insert(payload: bytes, rng: random.Random, piece: bytes) -> bytes:
    where = rng.randrange(len(payload) + 1)
    return payload[:where] + piece + payload[where:]


def _insert_bytes(payload: bytes, rng: random.Random) -> bytes:
    return _insert(payload, rng, rng.randbytes(rng.randint(1, 40)))


def _repeat_part(payload: bytes, rng: random.Random) -> bytes:
    start, stop = sorted(rng.randrange(len(payload)) for _ in range(2))
    return _insert(payload, rng, payload[start:stop])


def _insert_length(payload: bytes, rng: random.Random) -> bytes:
    return _insert(payload, rng, rng.choice(_HUGE_LENGTHS))


def _set_field(payload: bytes, rng: random.Random) -> bytes:
    fields = msgpack.unpackb(payload)
    part = fields["header"] if rng.random() < 0.3 else fields
    part[rng.choice([*part, "unknown"])] = rng.choice(_EDGE_VALUES)
    return bytes(msgpack.packb(fields))


def _delete_field(payload: bytes, rng: random.Random) -> bytes:
    fields = msgpack.unpackb(payload)
    part = fields["header"] if rng.random() < 0.3 else fields
    del part[rng.choice(list(part))]
    return bytes(msgpack.packb(fields))


def _edge_value(_: bytes, rng: random.Random) -> bytes:
    return bytes(msgpack.packb(rng.choice(_EDGE_VALUES)))


def _nest(_: bytes, rng: random.Random) -> bytes:
    return rng.choice(_CONTAINERS) * rng.randint(1, 3000)


DAMAGES: dict[str, Damage] = {
    "random bytes": _random_bytes,
    "flipped bits": _flip_bits,
    "overwritten bytes": _overwrite,
    "truncated": _truncate,
    "inserted bytes": _insert_bytes,
    "repeated part": _repeat_part,
    "huge length": _insert_length,
    "edge value in a field": _set_field,
    "missing field": _delete_field,
    "edge value alone": _edge_value,
    "deep nesting": _nest,
}
"""Damages by name; each takes a valid, non-empty payload and returns another one, valid or not."""
