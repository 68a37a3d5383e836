from typing import Any

FINGERPRINT: str

def pack(
    fields: tuple[tuple[str, bytes, bool], ...], values: dict[str, Any], /
) -> bytes | None: ...
