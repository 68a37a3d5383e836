from collections.abc import Callable
from typing import Any

import numpy as np
from pydantic import BaseModel

from common.schemas import Message

FINGERPRINT: str

class Prepared: ...  # a capsule

def prepare(
    around: tuple[bytes, ...],
    holes: tuple[tuple[str, int, int, str], ...],
    arrays: tuple[tuple[str, slice, tuple[int, ...] | None, int, bool], ...],
    header: tuple[type[BaseModel], set[str], dict[str, Any]],
    message: tuple[type[BaseModel], set[str], dict[str, Any]],
    check_numbers: Callable[[dict[str, Any]], dict[str, Any]] | None,
    refusal: type[Exception],
    frombuffer: Any,
    dtype: np.dtype[np.float64],
    tolerance: float,
    texts: tuple[str, str, str],
    slots: tuple[str, str, str, str],
    /,
) -> Prepared: ...
def read(prepared: Prepared, payload: bytes, injected_ns: int, /) -> Message | None: ...
