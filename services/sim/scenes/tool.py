"""A table with a cordless screwdriver that stands on its battery, and an open box for it."""

from typing import Any, Final

import mujoco

from services.sim.scenes.base import Quantity, Scene, View
from services.sim.scenes.furniture import FURNITURE_COLOURS, TABLE_QUANTITIES, TABLE_TOP, add_table
from services.sim.scenes.parts import (
    add_materials,
    add_walls,
    box_inertia,
    collision_geom,
    light_from,
    set_mass,
    visual_geom,
)

TOOL: Final = "tool"
TOOL_JOINT: Final = "tool_free"
BOX: Final = "box"
BOX_JOINT: Final = "box_free"
TOOL_PLACE: Final = (0.435, -0.28)
"""Where the tool stands (x, y) [m]."""
BOX_PLACE: Final = (0.435, -0.08)
"""Middle of the box (x, y) [m]."""
BOX_HALF: Final = (0.105, 0.08)
"""Half the box's inner sides [m]."""
BOX_HEIGHT: Final = 0.07
"""Of the box's walls [m]."""
GRIP_HEIGHT: Final = 0.10
"""Where to grip the tool, above what it stands on [m]: 2 cm above the torso frame."""

TOOL_BATTERY = Quantity("tool, battery", 0.16, "kg", "low centre of mass: it stands by itself")
TOOL_REST = Quantity("tool, handle and head", 0.12, "kg", "0.28 kg in all; 0.1 to 0.3 kg were held")
TOOL_GRIP = Quantity(
    "tool, sliding friction", 0.9, "", "rubber; the fingers' pads have 1.5 and rule"
)
BOX_MASS = Quantity("box, mass", 0.8, "kg", "a wooden box that a brush with the hand may shift")
BOX_GRIP = Quantity("box, sliding friction", 0.6, "", "wood on wood")
_BASE = (0.045, 0.032, 0.018)
_HANDLE = (0.019, 0.0185, 0.055)
_HEAD = (0.07, 0.024, 0.024)
_WALL = 0.005
_COLOURS = {
    **FURNITURE_COLOURS,
    "tool_body": (0.05, 0.47, 0.42, 0.5),
    "tool_grip": (0.09, 0.10, 0.11, 0.3),
    "tool_trim": (0.93, 0.73, 0.10, 0.4),
    "chuck": (0.60, 0.62, 0.65, 0.8),
    "crate": (0.80, 0.30, 0.12, 0.3),
    "crate_floor": (0.93, 0.89, 0.80, 0.1),
}


def _build(spec: Any) -> None:
    add_materials(spec, _COLOURS)
    light_from(spec, (-1.1, 1.2, 3.3), (0.5, -0.1, 0.0))
    add_walls(spec, {"wall.back": ((0.05, 6.0, 1.6), (2.4, 0.0, 1.6))})
    visual_geom(spec.worldbody, "box", (0.01, 6.0, 0.05), (2.34, 0.0, 0.05), "skirting")
    add_table(spec)
    _add_tool(spec)
    _add_box(spec)


def _add_tool(spec: Any) -> None:
    """Add the tool; its frame is in the middle of its sole."""
    tool = spec.worldbody.add_body(name=TOOL, pos=[*TOOL_PLACE, TABLE_TOP])
    tool.add_joint(name=TOOL_JOINT, type=mujoco.mjtJoint.mjJNT_FREE)
    grip = {"friction": (TOOL_GRIP.value, 0.005, 0.0001)}
    base, handle, head = _BASE[2], 2 * _BASE[2] + _HANDLE[2], 0.15
    collision_geom(tool, "tool.battery", "box", _BASE, (0.008, 0.0, base), "tool_grip", **grip)
    collision_geom(tool, "tool.handle", "box", _HANDLE, (0.0, 0.0, handle), "tool_body", **grip)
    collision_geom(tool, "tool.head", "box", _HEAD, (0.015, 0.0, head), "tool_body", **grip)
    visual_geom(tool, "box", (0.0462, 0.0332, 0.004), (0.008, 0.0, 0.026), "tool_trim")
    for side in (-1.0, 1.0):
        visual_geom(tool, "box", (0.012, 0.001, 0.04), (0.0, 0.0189 * side, handle), "tool_grip")
        visual_geom(tool, "box", (0.035, 0.001, 0.008), (0.0, 0.0244 * side, head), "tool_trim")
    visual_geom(tool, "cylinder", (0.022, 0.014), (0.092, 0.0, head), "tool_grip", quat=_ALONG_X)
    visual_geom(tool, "cylinder", (0.011, 0.016), (0.118, 0.0, head), "chuck", quat=_ALONG_X)
    visual_geom(tool, "cylinder", (0.003, 0.02), (0.148, 0.0, head), "chuck", quat=_ALONG_X)
    tool.add_site(name="tool_grip", pos=[0.0, 0.0, GRIP_HEIGHT], size=[0.005] * 3, group=4)
    low, rest = TOOL_BATTERY.value, TOOL_REST.value
    mass, upper = low + rest, 0.5 * (handle + head)
    centre = (low * base + rest * upper) / mass
    spread = low * (base - centre) ** 2 + rest * (upper - centre) ** 2
    x, y, z = box_inertia(mass, (0.04, 0.025, 0.03))
    inertia = (x + spread, y + spread, z)
    set_mass(tool, mass, inertia, (0.006, 0.0, centre))


_ALONG_X = (0.70710678, 0.0, 0.70710678, 0.0)


def _add_box(spec: Any) -> None:
    """Add the box; its frame is in the middle of its underside."""
    box = spec.worldbody.add_body(name=BOX, pos=[*BOX_PLACE, TABLE_TOP])
    box.add_joint(name=BOX_JOINT, type=mujoco.mjtJoint.mjJNT_FREE)
    grip = {"friction": (BOX_GRIP.value, 0.005, 0.0001)}
    x, y, half = *BOX_HALF, 0.5 * BOX_HEIGHT - _WALL
    middle = half + 2 * _WALL
    floor = (x + 2 * _WALL, y + 2 * _WALL, _WALL)
    collision_geom(box, "box.floor", "box", floor, (0.0, 0.0, _WALL), "crate_floor", **grip)
    for name, where, size in (
        ("far", (x + _WALL, 0.0, middle), (_WALL, y + 2 * _WALL, half)),
        ("near", (-x - _WALL, 0.0, middle), (_WALL, y + 2 * _WALL, half)),
        ("left", (0.0, y + _WALL, middle), (x, _WALL, half)),
        ("right", (0.0, -y - _WALL, middle), (x, _WALL, half)),
    ):
        collision_geom(box, f"box.{name}", "box", size, where, "crate", **grip)
    inertia = box_inertia(BOX_MASS.value, (x, y, half))
    set_mass(box, BOX_MASS.value, inertia, (0.0, 0.0, 0.4 * BOX_HEIGHT))


SCENE = Scene(
    name="tool",
    doc="table with a cordless screwdriver and an open box",
    build=_build,
    physics=(*TABLE_QUANTITIES, TOOL_BATTERY, TOOL_REST, TOOL_GRIP, BOX_MASS, BOX_GRIP),
    views=(
        View((0.30, -0.05, 0.82), -145.0, -20.0, 1.9),
        View((0.3, -0.1, 0.75), 140.0, -20.0, 2.3),
        View((0.38, -0.10, 0.82), -165.0, -34.0, 0.95),
    ),
)
