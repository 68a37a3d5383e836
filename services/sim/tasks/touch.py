"""Contacts by the names people use: which part of the robot touches which thing."""

import re
from typing import Any

import numpy as np
from numpy.typing import NDArray

from services.sim.contacts import normal_forces
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
    """Gathers what touched since it was last read, feeling every physics step."""

    def __init__(self, model: Any, data: Any) -> None:
        names = [model.geom(i).name for i in range(model.ngeom)]
        self._data = data
        self._touches: list[Touch | None] = [None]
        self._code: NDArray[np.int32] = np.zeros((model.ngeom, model.ngeom), dtype=np.int32)
        known: dict[Touch, int] = {}
        for i, one in enumerate(names):
            for j in range(i):
                touch = _touch(one, names[j]) if one and names[j] else None
                if touch is None:
                    continue
                if touch not in known:
                    known[touch] = len(self._touches)
                    self._touches.append(touch)
                self._code[i, j] = self._code[j, i] = known[touch]
        self._felt: dict[int, float] = {}

    def feel(self) -> None:
        """Note the contacts of the last physics step."""
        data = self._data
        if not data.ncon:
            return
        geoms = data.contact.geom
        codes = self._code[geoms[:, 0], geoms[:, 1]]
        hits = codes.nonzero()[0]
        if not hits.size:
            return
        forces = normal_forces(data)[hits]
        sums: dict[int, float] = {}
        for code, force in zip(codes[hits].tolist(), forces.tolist(), strict=True):
            sums[code] = sums.get(code, 0.0) + force
        for code, force in sums.items():
            if force > self._felt.get(code, 0.0):
                self._felt[code] = force

    def read(self) -> dict[Touch, float]:
        """What touched since the last call, with its largest normal force [N]."""
        felt, self._felt = self._felt, {}
        return {touch: force for code, force in felt.items() if (touch := self._touches[code])}
