from typing import Any

FINGERPRINT: str

Fields = tuple[tuple[str, bytes, bool], ...]

def pack(fields: Fields, values: dict[str, Any], /) -> bytes | None: ...
def pack_with_header(
    prefix: bytes, fields: Fields, header: dict[str, Any], body: bytes, head: int, /
) -> bytes | None: ...
