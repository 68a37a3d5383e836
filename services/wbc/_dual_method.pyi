from common.schemas.arrays import Float64Array as Array

FINGERPRINT: str

def solve(
    P: Array,
    q: Array,
    A: Array,
    l: Array,
    u: Array,
    B: Array,
    b: Array,
    x: Array,
    dense: int,
    equalities: int,
    slack_weight: float,
    tolerance: float,
    /,
) -> int: ...
