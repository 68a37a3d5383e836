from common.schemas.arrays import Float64Array as Array

FINGERPRINT: str

def write_tasks(
    rows: Array,
    error: Array,
    kp: Array,
    kd: Array,
    position: Array,
    rotation: Array,
    velocity: Array,
    acceleration: Array,
    jacobian: Array,
    measured: Array,
    bias: Array,
    com: Array,
    base_rotation: Array,
    positions: Array,
    rotations: Array,
    motor_position: Array,
    motor_velocity: Array,
    /,
) -> None: ...
def fill(
    P: Array,
    q: Array,
    A: Array,
    l: Array,
    u: Array,
    rows: Array,
    weight: Array,
    motor_position: Array,
    motor_velocity: Array,
    mass: Array,
    force: Array,
    soles: Array,
    torque_limit: Array,
    arm_limits: Array,
    /,
    *scalars: float,
) -> None: ...
