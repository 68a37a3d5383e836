from common.schemas.arrays import Float64Array as Array

FINGERPRINT: str

def law(
    position: Array,
    velocity: Array,
    acceleration: Array,
    torque: Array,
    stiffness: Array,
    damping: Array,
    to_motors: Array,
    law: Array,
    /,
) -> None: ...
