"""Contacts by name: which part of the robot is in contact with which object of the scene."""

import re
from functools import cache
from typing import Any

from services.sim.model.contacts import normal_forces
from services.sim.tasks.base import Contact

_MOST_IDLE = 1000
_SIDES = {"l": "left", "r": "right"}
_ROBOT_GEOM = re.compile(r"(?:(?P<side>[lr])_)?(?P<shape>[a-z_]+?)(?:_[ab])?_col")
_PARTS = {
    "pelvis": "pelvis",
    "chest": "chest",
    "yoke": "chest",
    "head": "head",
    "hip_motor": "hip",
    "thigh": "thigh",
    "shank_up": "knee",
    "shank_low": "shin",
    "foot": "foot",
    "shoulder": "shoulder",
    "upper_arm": "upper arm",
    "elbow_motor": "elbow",
    "forearm": "forearm",
    "wrist": "wrist",
    "palm": "palm",
    "finger": "finger",
}


@cache
def robot_part(geom: str) -> tuple[str, str] | None:
    """Return (side, part) of the robot's collision geom ``geom``; None for any other geom."""
    match = _ROBOT_GEOM.fullmatch(geom)
    if match is None or match["shape"] not in _PARTS:
        return None
    return _SIDES.get(match["side"] or "", ""), _PARTS[match["shape"]]


def object_of(geom: str) -> str:
    """Return the object to which the scene's geom ``<object>.<part>`` belongs."""
    return geom.split(".", maxsplit=1)[0].replace("_", " ")


def _contact(one: str, other: str) -> Contact | None:
    """Return the contact of two geoms; None within the robot, within an object and for feet."""
    first, second = robot_part(one), robot_part(other)
    if first and second:
        return None
    if first or second:
        side, part = first or second or ("", "")
        name = object_of(other if first else one)
        return None if name == "floor" else Contact(side, part, name)
    # The floor comes last: "hammer on floor".
    names = sorted((object_of(one), object_of(other)), key=lambda name: (name == "floor", name))
    return None if names[0] == names[1] else Contact("", names[0], names[1])


class ContactSensor:
    """Collects the contacts between two readings.

    Those of the robot are collected at every physics step, so that none is missed; those between
    objects, which last, only in the step before a reading.
    """

    def __init__(self, model: Any, data: Any) -> None:
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._data = data
        # Dictionaries: a dozen contacts a step are too few for array operations to pay.
        self._of_robot: dict[tuple[int, int], Contact] = {}
        self._all: dict[tuple[int, int], Contact] = {}
        for i, one in enumerate(names):
            for j, other in enumerate(names):
                contact = _contact(one, other) if one and other else None
                if contact is None:
                    continue
                self._all[i, j] = contact
                if robot_part(one) or robot_part(other):
                    self._of_robot[i, j] = contact
        self._peaks: dict[Contact, float] = {}
        self._idle: dict[bool, set[bytes]] = {False: set(), True: set()}
        """Pairs of a step, as bytes, none of which is known; by whether objects' pairs are."""

    def collect(self, *, between_objects: bool) -> None:
        """Add the contacts of the last physics step.

        Args:
            between_objects: include contacts without the robot.
        """
        data = self._data
        if not data.ncon:
            return
        pairs, idle = data.contact.geom, self._idle[between_objects]
        # Most contacts are those of the feet with the floor, which nobody asks for.
        if (step := pairs.tobytes()) in idle:
            return
        known = self._all if between_objects else self._of_robot
        if known.keys().isdisjoint(map(tuple, pairs.tolist())):
            if len(idle) >= _MOST_IDLE:
                idle.clear()
            idle.add(step)
            return
        sums: dict[Contact, float] = {}
        for pair, force in normal_forces(data):
            if (contact := known.get(pair)) is not None:
                sums[contact] = sums.get(contact, 0.0) + force
        for contact, force in sums.items():
            self._peaks[contact] = max(force, self._peaks.get(contact, 0.0))

    def read(self) -> dict[Contact, float]:
        """Return the contacts since the last reading with their largest normal force [N]."""
        peaks, self._peaks = self._peaks, {}
        return peaks
