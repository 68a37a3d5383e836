"""What a scene is, and the numbers its physics is made of."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Quantity:
    """One physical number of a scene, with the reason it has this value.

    Attributes:
        what: thing and quantity, as people say it.
        value: in ``unit``.
        unit: SI.
        why: where the number is from, or what asks for it.
    """

    what: str
    value: float
    unit: str
    why: str


@dataclass(frozen=True, slots=True)
class View:
    """A camera outside: what it looks at and from where.

    Attributes:
        target: (x, y, z) in world [m].
        azimuth: direction of view, counter-clockwise from +x [deg].
        elevation: of the view [deg]; negative looks down.
        distance: to the target [m].
    """

    target: tuple[float, float, float]
    azimuth: float
    elevation: float
    distance: float


@dataclass(frozen=True, slots=True)
class Scene:
    """What stands around the robot besides floor, sky and light.

    Geoms that can be touched are called ``<thing>.<part>``: contacts are told by the thing, with
    blanks for underscores. All of them have names.

    Attributes:
        name: as given in the configuration.
        doc: one line for ``--help``.
        build: adds bodies to the ``mujoco.MjSpec`` of robot and floor; the robot starts at the
            world's origin and faces +x. Joints and actuators come after the robot's; shapes that
            only look have group 2, no mass and no contacts.
        physics: the masses, frictions and springs that ``build`` uses.
        views: three cameras for pictures.
    """

    name: str
    doc: str
    build: Callable[[Any], None]
    physics: tuple[Quantity, ...] = ()
    views: tuple[View, ...] = ()
