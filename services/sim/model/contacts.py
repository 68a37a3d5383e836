"""Contacts between geoms and their normal forces."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.schemas.arrays import Float64Array as Array


class GeomContact(NamedTuple):
    """Contact of two geoms, in the order of their names.

    Attributes:
        first: name.
        second: name.
        force: normal force [N].
    """

    first: str
    second: str
    force: float


def normal_forces(data: Any) -> Array:
    """Return the normal force (ncon,) of each contact of the last step [N]; 0 where inactive.

    With elliptic (or frictionless) cones the first constraint row of a contact is its normal.
    """
    if not (data.ncon and data.nefc):
        return np.zeros(data.ncon)
    rows = data.contact.efc_address
    forces: Array = data.efc_force[rows] * (rows >= 0)
    return forces


def foot_normal_forces(data: Any, feet: NDArray[np.intp]) -> Array:
    """Return the total normal force (2,) on the left and the right foot [N].

    Args:
        data: the ``mujoco.MjData``.
        feet: (2,) geom ids; left, right.
    """
    total = dict.fromkeys(feet.tolist(), 0.0)
    # A loop: a dozen contacts are too few for array operations to pay.
    for pair, force in zip(data.contact.geom.tolist(), normal_forces(data).tolist(), strict=True):
        for geom in pair:
            if geom in total:
                total[geom] += force
    return np.array(list(total.values()))


def geom_contacts(model: Any, data: Any) -> list[GeomContact]:
    """Return the contacts with their total normal forces, sorted by name."""
    total: dict[tuple[str, str], float] = {}
    for (one, other), force in zip(data.contact.geom, normal_forces(data), strict=True):
        first, second = sorted((model.geom(int(one)).name, model.geom(int(other)).name))
        total[first, second] = total.get((first, second), 0.0) + float(force)
    return [GeomContact(*pair, force) for pair, force in sorted(total.items())]
