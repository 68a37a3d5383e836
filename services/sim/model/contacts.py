"""Contacts by geom name, for scoring and for the measured foot forces."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from common.schemas.arrays import Float64Array as Array


class Contact(NamedTuple):
    """One touching pair; ``first < second`` by name. ``force`` is its normal force [N]."""

    first: str
    second: str
    force: float


def normal_forces(data: Any) -> Array:
    """(ncon,) normal force of each contact of the last physics step [N]; 0 where inactive.

    With elliptic (or frictionless) cones the first constraint row of a contact is its normal.
    """
    if not (data.ncon and data.nefc):
        return np.zeros(data.ncon)
    rows = data.contact.efc_address
    forces: Array = data.efc_force[rows] * (rows >= 0)
    return forces


def foot_normal_forces(data: Any, feet: NDArray[np.intp]) -> Array:
    """(2,) sum of the normal forces on the foot geoms ``feet`` (2,): left, right [N]."""
    total = dict.fromkeys(feet.tolist(), 0.0)
    # A loop: a dozen contacts are too few for array operations to pay.
    for pair, force in zip(data.contact.geom.tolist(), normal_forces(data).tolist(), strict=True):
        for geom in pair:
            if geom in total:
                total[geom] += force
    return np.array(list(total.values()))


def contact_list(model: Any, data: Any) -> list[Contact]:
    """Touching pairs of geoms with their summed normal forces, sorted by name."""
    total: dict[tuple[str, str], float] = {}
    for (one, other), force in zip(data.contact.geom, normal_forces(data), strict=True):
        first, second = sorted((model.geom(int(one)).name, model.geom(int(other)).name))
        total[first, second] = total.get((first, second), 0.0) + float(force)
    return [Contact(*pair, force) for pair, force in sorted(total.items())]
