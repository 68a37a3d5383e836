"""Notice a state that robot and scene cannot have: the physics has diverged."""

from typing import Any

import numpy as np

from common.schemas.arrays import Float64Array as Array
from services.sim.errors import PlantDivergedError

FARTHEST = 1e4
"""Norm of all positions beyond which the physics has diverged [m, rad]."""
FASTEST = 1e3
"""Norm of all speeds beyond which it has [m/s, rad/s]; the hardest push reaches 280."""
_FARTHEST_SQUARED, _FASTEST_SQUARED = FARTHEST**2, FASTEST**2


def is_possible(qpos: Array, qvel: Array) -> bool:
    """Return whether all numbers of a state (nq,), (nv,) are finite and within all bounds."""
    # NaN compares as out of bounds, and one entry of it is enough.
    return bool(qpos.dot(qpos) <= _FARTHEST_SQUARED and qvel.dot(qvel) <= _FASTEST_SQUARED)


def check_state(model: Any, qpos: Array, qvel: Array) -> None:
    """Refuse a state of robot or scene that is not finite, or beyond all bounds.

    Args:
        model: the ``mujoco.MjModel``.
        qpos: (nq,) positions [m, rad].
        qvel: (nv,) velocities [m/s, rad/s].

    Raises:
        PlantDivergedError: naming the worst joint.
    """
    if is_possible(qpos, qvel):
        return
    raise PlantDivergedError(
        f"the physics diverged: expected positions and speeds below {FARTHEST:g} m and "
        f"{FASTEST:g} m/s (rad, rad/s), got {_worst(model, qpos, qvel)}; reset the plant and "
        "lower gains or forces"
    )


def _worst(model: Any, qpos: Array, qvel: Array) -> str:
    """Name the joint with the largest or a non-finite number, and that number."""
    for name, values, address, bound in (
        ("position", qpos, model.jnt_qposadr, FARTHEST),
        ("speed", qvel, model.jnt_dofadr, FASTEST),
    ):
        # NaN counts as the largest.
        index = int(np.abs(values).argmax())
        if not abs(values[index]) <= bound:
            joint = model.joint(int(np.searchsorted(address, index, side="right")) - 1)
            return f"{name} {values[index]:g} of {joint.name or 'an unnamed joint'}"
    return "many large numbers"
