"""Reading the header off a message's bytes, for those who carry bytes and need no more."""

import msgpack

from common.schemas import Header

_HEAD = 1024
"""Bytes in which a header fits, so that a picture need not be copied to read it."""


def wire_header(payload: bytes) -> Header | None:
    """Read the header off a message's bytes without decoding the rest; None if there is none.

    The message is a msgpack map with a ``header`` map, as a rule its first entry.
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
                return Header.model_validate(unpacker.unpack(), strict=True)
            unpacker.skip()
    except (msgpack.exceptions.UnpackException, ValueError, TypeError):
        return None
    return None
