"""What a scene is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True, slots=True)
class Scene:
    """What stands around the robot besides floor, sky and light.

    Attributes:
        name: as given in the configuration.
        doc: one line for ``--help``.
        build: adds bodies to the ``mujoco.MjSpec`` of robot and floor; the robot starts at the
            world's origin and faces +x. Joints and actuators come after the robot's; shapes that
            only look have group 2, no mass and no contacts.
    """

    name: str
    doc: str
    build: Callable[[Any], None]
