"""Reading the header off a message's bytes, for those who carry bytes and need no more."""

import msgpack

from common.schemas import Header


def wire_header(payload: bytes) -> Header | None:
    """Read the header off a message's bytes without decoding the rest; None if there is none.

    The message is a msgpack map with a ``header`` map, as a rule its first entry.
    """
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
