"""Definition of a scene, its physical quantities and its cameras."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Quantity:
    """A physical quantity of a scene, with the reason for its value.

    Attributes:
        what: object and quantity.
        value: in ``unit``.
        unit: SI unit; empty: none.
        why: source of the value, or the purpose it serves.
    """

    what: str
    value: float
    unit: str
    why: str


@dataclass(frozen=True, slots=True)
class View:
    """A fixed camera outside the robot.

    Attributes:
        target: (x, y, z) that it looks at, in world [m].
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
    """Surroundings of the robot besides floor, sky and light.

    Every collision geom is named ``<object>.<part>``; contacts are reported by the object, with
    blanks for underscores.

    Attributes:
        name: as in the configuration.
        doc: one line for ``--help``.
        build: adds bodies to the ``mujoco.MjSpec`` of robot and floor; the robot starts at the
            world's origin and faces +x. Joints and actuators come after the robot's. Visual geoms
            have group 2, no mass and no contacts.
        physics: masses, frictions and springs that ``build`` uses.
        views: three cameras for pictures.
    """

    name: str
    doc: str
    build: Callable[[Any], None]
    physics: tuple[Quantity, ...] = ()
    views: tuple[View, ...] = ()
