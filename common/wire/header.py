"""Read the header off a message's bytes without decoding the rest."""

import msgpack

from common.schemas import Header

_HEAD = 1024
"""Bytes in which a header fits, so that a picture need not be copied to read it."""


def wire_header(payload: bytes) -> Header | None:
    """Return the header in a message's bytes; None if there is none.

    The message is a msgpack map with a ``header`` map, as a rule its first entry. Fields of a newer
    version's header are left out.
    """
    if len(payload) > _HEAD:
        header = _header_in(payload[:_HEAD])
        if header is not None:
            return header
    return _header_in(payload)


def _header_in(payload: bytes) -> Header | None:
    try:
        unpacker = msgpack.Unpacker(max_buffer_size=max(1, len(payload)))
        unpacker.feed(payload)
        for _ in range(unpacker.read_map_header()):
            if unpacker.unpack() == "header":
                fields = unpacker.unpack()
                known = {name: fields[name] for name in Header.model_fields if name in fields}
                return Header.model_validate(known, strict=True)
            unpacker.skip()
    except (msgpack.exceptions.UnpackException, ValueError, TypeError):
        return None
    return None
