from common.schemas.arrays import Float64Array as Array

FINGERPRINT: str

class Prepared: ...  # a capsule

def prepare(
    *,
    step1: int,
    step2: int,
    user_error: int,
    error: type[Exception],
    model: int,
    data: int,
    torque: Array,
    length: Array,
    velocity: Array,
    qpos: Array,
    qvel: Array,
    rotation: Array,
    per_joint: Array,
    lowest: Array,
    highest: Array,
    step_ns: int,
    extrapolation_ns: int,
    fade: float,
    height: float,
    uprightness: float,
    farthest_squared: float,
    fastest_squared: float,
) -> Prepared: ...
def run(
    prepared: Prepared, law: Array, stamp_ns: int, now_ns: int, most: int, watch_fall: bool, /
) -> tuple[int, int, bool]: ...
