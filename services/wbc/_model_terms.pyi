from common.schemas.arrays import Float64Array as Array

FINGERPRINT: str

_Limb = tuple[Array, Array, tuple[float, float, float], bytes, bytes, int]

def prepare(
    J: Array,
    M: Array,
    h: Array,
    rotation: Array,
    position: Array,
    gravity: tuple[float, float, float],
    left_hand: _Limb,
    right_hand: _Limb,
    left_foot: _Limb,
    right_foot: _Limb,
    /,
) -> object: ...
def update(
    prepared: object,
    v: Array,
    rotation: Array,
    com: Array,
    mass: Array,
    force: Array,
    jacobian: Array,
    velocity: Array,
    bias: Array,
    positions: Array,
    rotations: Array,
    soles: Array,
    /,
) -> None: ...
