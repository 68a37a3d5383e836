"""Contacts between geoms and their normal forces."""

from typing import Any, NamedTuple

import numpy as np

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


def normal_forces(data: Any) -> list[tuple[tuple[int, int], float]]:
    """Return geom ids and normal force [N] of each contact of the last step; 0 where inactive.

    With elliptic (or frictionless) cones the first constraint row of a contact is its normal.
    """
    contacts, forces = data.contact, data.efc_force.tolist()
    # A loop: a dozen contacts are too few for array operations to pay.
    return [
        ((one, other), forces[row] if row >= 0 else 0.0)
        for (one, other), row in zip(
            contacts.geom.tolist(), contacts.efc_address.tolist(), strict=True
        )
    ]


def foot_normal_forces(data: Any, feet: tuple[int, int]) -> Array:
    """Return the total normal force (2,) on the left and the right foot [N].

    Args:
        data: the ``mujoco.MjData``.
        feet: geom ids; left, right.
    """
    left, right = feet
    on_left = on_right = 0.0
    contacts, forces = data.contact, data.efc_force.tolist()
    for pair, row in zip(contacts.geom.tolist(), contacts.efc_address.tolist(), strict=True):
        if row < 0:
            continue
        if left in pair:
            on_left += forces[row]
        if right in pair:
            on_right += forces[row]
    return np.array((on_left, on_right))


def geom_contacts(model: Any, data: Any) -> list[GeomContact]:
    """Return the contacts with their total normal forces, sorted by name."""
    total: dict[tuple[str, str], float] = {}
    for pair, force in normal_forces(data):
        first, second = sorted(model.geom(geom).name for geom in pair)
        total[first, second] = total.get((first, second), 0.0) + force
    return [GeomContact(*pair, force) for pair, force in sorted(total.items())]
