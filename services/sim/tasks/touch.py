"""Contacts by the names people use: which part of the robot touches which thing."""

import re
from typing import Any

from services.sim.model.contacts import normal_forces
from services.sim.tasks.base import Touch

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


def robot_part(geom: str) -> tuple[str, str] | None:
    """(side, part) of the robot's collision shape ``geom``; None if it is not the robot's."""
    match = _ROBOT_GEOM.fullmatch(geom)
    if match is None or match["shape"] not in _PARTS:
        return None
    return _SIDES.get(match["side"] or "", ""), _PARTS[match["shape"]]


def thing_of(geom: str) -> str:
    """The thing that the scene's shape ``geom`` (``<thing>.<part>``) belongs to."""
    return geom.split(".", maxsplit=1)[0].replace("_", " ")


def _touch(one: str, other: str) -> Touch | None:
    """What it means that these two shapes touch; None if it is of no interest."""
    first, second = robot_part(one), robot_part(other)
    if first and second:
        return None
    if first or second:
        side, part = first or second or ("", "")
        thing = thing_of(other if first else one)
        return None if thing == "floor" else Touch(side, part, thing)
    # The floor last: "hammer on floor".
    low, high = sorted((thing_of(one), thing_of(other)), key=lambda name: (name == "floor", name))
    return None if low == high else Touch("", low, high)


class TouchSensor:
    """Gathers what touched since it was last read.

    The robot's touches are felt at every physics step, so that none is missed; those of things
    among themselves, which last, only in the step before they are read.
    """

    def __init__(self, model: Any, data: Any) -> None:
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._data = data
        # Dictionaries: a dozen contacts a step are too few for array operations to pay.
        self._robots: dict[tuple[int, int], Touch] = {}
        self._all: dict[tuple[int, int], Touch] = {}
        for i, one in enumerate(names):
            for j, other in enumerate(names):
                touch = _touch(one, other) if one and other else None
                if touch is None:
                    continue
                self._all[i, j] = touch
                if robot_part(one) or robot_part(other):
                    self._robots[i, j] = touch
        self._felt: dict[Touch, float] = {}

    def feel(self, *, things: bool) -> None:
        """Note the contacts of the last physics step, those among ``things`` too if wanted."""
        data = self._data
        if not data.ncon:
            return
        known = self._all if things else self._robots
        touches = [known.get((one, other)) for one, other in data.contact.geom.tolist()]
        if not any(touches):
            return
        sums: dict[Touch, float] = {}
        for touch, force in zip(touches, normal_forces(data).tolist(), strict=True):
            if touch is not None:
                sums[touch] = sums.get(touch, 0.0) + force
        for touch, force in sums.items():
            self._felt[touch] = max(force, self._felt.get(touch, 0.0))

    def read(self) -> dict[Touch, float]:
        """What touched since the last call, with its largest normal force [N]."""
        felt, self._felt = self._felt, {}
        return felt
