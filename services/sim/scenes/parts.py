"""Building blocks of the scenes: collision geoms, visual geoms, materials, masses and lights."""

from collections.abc import Mapping, Sequence
from typing import Any

import mujoco

COLLISION_GROUP = 1
"""Group of visible geoms with contacts; bodies get their masses explicitly."""
VISUAL_GROUP = 2
"""Group of geoms without mass and contacts."""
KEY_LIGHT = "key"
"""Name of the light that casts shadows."""

_SHAPES = {
    "box": mujoco.mjtGeom.mjGEOM_BOX,
    "capsule": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "cylinder": mujoco.mjtGeom.mjGEOM_CYLINDER,
    "sphere": mujoco.mjtGeom.mjGEOM_SPHERE,
    "ellipsoid": mujoco.mjtGeom.mjGEOM_ELLIPSOID,
}

Numbers = Sequence[float]
Box = tuple[Numbers, Numbers]
"""Half sizes and centre [m]."""


def add_materials(spec: Any, colours: Mapping[str, Numbers]) -> None:
    """Add a material per name: (r, g, b, gloss 0..1)."""
    for name, (red, green, blue, gloss) in colours.items():
        spec.add_material(
            name=name,
            rgba=[red, green, blue, 1.0],
            specular=gloss,
            shininess=gloss,
            reflectance=0.0,
        )


def collision_geom(
    body: Any,
    name: str,
    shape: str,
    size: Numbers,
    pos: Numbers = (0.0, 0.0, 0.0),
    material: str = "",
    **options: Any,
) -> Any:
    """Add a visible geom with contacts.

    Args:
        body: of the spec.
        name: ``<object>.<part>``, unique.
        shape: ``box``, ``capsule``, ``cylinder``, ``sphere`` or ``ellipsoid``.
        size: MuJoCo half sizes [m].
        pos: centre in the body [m].
        material: name of its material.
        **options: further attributes of the geom.
    """
    return body.add_geom(
        name=name,
        type=_SHAPES[shape],
        size=_three(size),
        pos=list(pos),
        material=material,
        density=0.0,
        group=COLLISION_GROUP,
        condim=3,
        **{key: _plain(value) for key, value in options.items()},
    )


def visual_geom(
    body: Any,
    shape: str,
    size: Numbers,
    pos: Numbers = (0.0, 0.0, 0.0),
    material: str = "",
    **options: Any,
) -> Any:
    """Add a geom without mass and contacts; arguments as in :func:`collision_geom`."""
    return body.add_geom(
        type=_SHAPES[shape],
        size=_three(size),
        pos=list(pos),
        material=material,
        density=0.0,
        group=VISUAL_GROUP,
        contype=0,
        conaffinity=0,
        **{key: _plain(value) for key, value in options.items()},
    )


def set_mass(body: Any, mass: float, inertia: Numbers, centre: Numbers = (0.0, 0.0, 0.0)) -> None:
    """Set a body's mass [kg], principal inertia [kg·m²] and centre of mass [m]."""
    body.explicitinertial = True
    body.mass = mass
    body.inertia = list(inertia)
    body.ipos = list(centre)


def box_inertia(mass: float, half: Numbers) -> list[float]:
    """Return the principal inertia [kg·m²] of a homogeneous box with these half sizes [m]."""
    x, y, z = (4.0 * side * side for side in half)
    return [mass * (y + z) / 12.0, mass * (x + z) / 12.0, mass * (x + y) / 12.0]


def add_walls(spec: Any, boxes: Mapping[str, Box], material: str = "wall", **options: Any) -> None:
    """Add fixed boxes ``name: (half sizes, centre)`` to the world."""
    for name, (size, pos) in boxes.items():
        collision_geom(spec.worldbody, name, "box", size, pos, material, **options)


def light_from(spec: Any, pos: Numbers, target: Numbers) -> None:
    """Let the light that casts shadows shine from ``pos`` at ``target``.

    Both are relative to the robot, which the light follows.
    """
    aim = [there - here for here, there in zip(pos, target, strict=True)]
    length = sum(value * value for value in aim) ** 0.5
    key = spec.light(KEY_LIGHT)
    key.pos, key.dir = list(pos), [value / length for value in aim]


def add_glow(spec: Any, pos: Numbers, strength: float = 0.25) -> None:
    """Add a light without shadows at ``pos`` in the world, shining at the origin."""
    spec.worldbody.add_light(
        type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL,
        pos=list(pos),
        dir=[-value for value in pos],
        diffuse=[strength] * 3,
        specular=[0.0, 0.0, 0.0],
        castshadow=False,
    )


def _three(size: Numbers) -> list[float]:
    return [*size, 0.0, 0.0][:3]


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value
