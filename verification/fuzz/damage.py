"""Ways to damage a payload."""

import math
import random
import struct
from collections.abc import Callable
from typing import Any

import msgpack

_NASTY: tuple[Any, ...] = (
    None,
    True,
    -1,
    2**63,
    2**64 - 1,
    -(2**63),
    math.nan,
    math.inf,
    -math.inf,
    1e308,
    "",
    "x" * 500,
    b"",
    b"\0" * 216,
    struct.pack("<27d", *[math.nan] * 27),
    struct.pack("<3d", math.inf, 0.0, 0.0),
    struct.pack("<4d", 0.0, 0.0, 0.0, 0.0),
    [],
    [[[]]],
    {},
    {"header": {}},
)
_LENGTHS = (b"\xdd\xff\xff\xff\xff", b"\xdf\xff\xff\xff\xff", b"\xc6\xff\xff\xff\xff", b"\xc9\x7f")
"""An array, a map, bytes and an extension, all of them far longer than the payload."""


def _random_bytes(_: bytes, rng: random.Random) -> bytes:
    return rng.randbytes(rng.randrange(400))


def _flipped(payload: bytes, rng: random.Random) -> bytes:
    data = bytearray(payload)
    for _ in range(rng.randint(1, 6)):
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)
    return bytes(data)


def _overwritten(payload: bytes, rng: random.Random) -> bytes:
    data = bytearray(payload)
    start = rng.randrange(len(data))
    piece = rng.randbytes(rng.randint(1, 16))
    data[start : start + len(piece)] = piece
    return bytes(data)


def _cut(payload: bytes, rng: random.Random) -> bytes:
    return payload[: rng.randrange(len(payload))]


def _grown(payload: bytes, rng: random.Random) -> bytes:
    where = rng.randrange(len(payload) + 1)
    return payload[:where] + rng.randbytes(rng.randint(1, 40)) + payload[where:]


def _spliced(payload: bytes, rng: random.Random) -> bytes:
    start, stop, where = (rng.randrange(len(payload)) for _ in range(3))
    return payload[:where] + payload[min(start, stop) : max(start, stop)] + payload[where:]


def _huge(payload: bytes, rng: random.Random) -> bytes:
    where = rng.randrange(len(payload))
    return payload[:where] + rng.choice(_LENGTHS) + payload[where:]


def _nasty_field(payload: bytes, rng: random.Random) -> bytes:
    fields = msgpack.unpackb(payload)
    inside = fields["header"] if rng.random() < 0.3 else fields
    inside[rng.choice([*inside, "unknown"])] = rng.choice(_NASTY)
    return bytes(msgpack.packb(fields))


def _lost_field(payload: bytes, rng: random.Random) -> bytes:
    fields = msgpack.unpackb(payload)
    inside = fields["header"] if rng.random() < 0.3 else fields
    del inside[rng.choice(list(inside))]
    return bytes(msgpack.packb(fields))


def _nasty_value(_: bytes, rng: random.Random) -> bytes:
    return bytes(msgpack.packb(rng.choice(_NASTY)))


def _nested(_: bytes, rng: random.Random) -> bytes:
    return rng.choice((b"\x91", b"\x81\xa1a", b"\x81\xa6header")) * rng.randint(1, 3000)


Damage = Callable[[bytes, random.Random], bytes]
DAMAGES: dict[str, Damage] = {
    "random bytes": _random_bytes,
    "bits flipped": _flipped,
    "overwritten": _overwritten,
    "cut off": _cut,
    "grown": _grown,
    "spliced": _spliced,
    "huge lengths": _huge,
    "nasty field": _nasty_field,
    "lost field": _lost_field,
    "nasty value": _nasty_value,
    "nested": _nested,
}
"""By name; each takes a good payload (not empty) and returns another one, good or bad."""
