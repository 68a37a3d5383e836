"""A tool wall with a hammer on a hanger, and a heavy trolley to carry it away.

The pegboard stands in front of the world's origin, the hammer hangs before the right hand. The
trolley slides on the floor with planar motion; tasks choose where it stands.
"""

from typing import Any, Final

import mujoco
import numpy as np

from services.sim.scenes.base import Quantity, Scene, View
from services.sim.scenes.cart import CART_QUANTITIES, add_cart
from services.sim.scenes.parts import (
    add_materials,
    add_walls,
    collision_geom,
    light_from,
    set_mass,
    visual_geom,
)

HAMMER: Final = "hammer"
HAMMER_JOINT: Final = "hammer_free"
HANGER: Final = (0.40, -0.20)
"""Where the hammer hangs (x, y) [m]."""
PRONG_HEIGHT: Final = 0.9225
"""Of the prongs' axes [m]: 10 cm above the standing robot's torso frame."""
GRIP_BELOW: Final = 0.14
"""Where to grip the hammer: this far below the middle of its head, at the torso's height [m]."""
BOARD_FRONT: Final = 0.55
PUSH_LANE: Final = -1.2
"""World y of the lane in which the trolley is pushed [m]."""
PUSH_GOAL: Final = (1.82, PUSH_LANE)
"""Where the trolley's centre is to be pushed (x, y) [m]; marked on the floor."""

_GRASPED = "prototype: gripped, carried and put down 11 of 12 times"
HAMMER_HEAD = Quantity("hammer, head", 0.12, "kg", _GRASPED)
HAMMER_HANDLE = Quantity("hammer, handle", 0.08, "kg", _GRASPED)
HAMMER_GRIP = Quantity("hammer, sliding friction", 1.0, "", "rubber grip; pads have 1.5 and rule")
PRONG_FRICTION = Quantity("hanger, sliding friction", 0.6, "", "painted steel wire")
_PRONG_RADIUS = 0.015
_PRONG_GAP = 0.05
_HEAD_HALF = (0.0225, 0.07, 0.0225)
_HANDLE_HALF = (0.018, 0.02, 0.125)
HAMMER_REST: Final = PRONG_HEIGHT + _PRONG_RADIUS + _HEAD_HALF[2]
"""Height of the head's centre when it lies on the prongs [m]."""
_COLOURS = {
    "wall": (0.72, 0.77, 0.75, 0.05),
    "skirting": (0.93, 0.92, 0.89, 0.2),
    "board_edge": (0.42, 0.27, 0.15, 0.25),
    "prong": (0.72, 0.74, 0.77, 0.8),
    "head": (0.45, 0.47, 0.50, 0.8),
    "grip": (0.78, 0.09, 0.08, 0.4),
    "grip_end": (0.10, 0.10, 0.11, 0.3),
    "shadow": (0.93, 0.91, 0.86, 0.1),
    "mark": (0.30, 0.78, 0.40, 0.1),
}


def _build(spec: Any) -> None:
    add_materials(spec, _COLOURS)
    light_from(spec, (-1.3, 1.3, 3.4), (0.4, -0.3, 0.0))
    add_walls(spec, {"wall.back": ((0.05, 6.0, 1.6), (3.05, -0.6, 1.6))})
    visual_geom(spec.worldbody, "box", (0.01, 6.0, 0.05), (2.99, -0.6, 0.05), "skirting")
    _add_board(spec)
    _add_hanger(spec)
    _add_hammer(spec)
    _add_goal_mark(spec)
    add_cart(spec)


def _peg_texture() -> bytes:
    """Return one tile of the board: wood with a dark hole in its middle."""
    size = 64
    rows, columns = np.mgrid[0:size, 0:size] - 31.5
    radius = np.hypot(rows, columns)
    tile = np.empty((size, size, 3))
    tile[:] = (214, 178, 128)
    tile[radius < 11.0] = (180, 144, 96)
    tile[radius < 9.0] = (62, 44, 28)
    return tile.astype(np.uint8).tobytes()


def _add_board(spec: Any) -> None:
    texture = spec.add_texture(
        name="pegs", type=mujoco.mjtTexture.mjTEXTURE_2D, width=64, height=64, nchannel=3
    )
    texture.data = _peg_texture()
    board = spec.add_material(name="board", texuniform=True, texrepeat=[20.0, 20.0], specular=0.1)
    board.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "pegs"
    centre_y, half_y, half_z = -0.05, 0.32, 0.43
    x, z = BOARD_FRONT + 0.012, 0.99
    # The texture lies in the geom's own x-y plane: its z has to look at the robot.
    facing = (0.5, -0.5, -0.5, 0.5)
    half, where = (half_y, half_z, 0.012), (x, centre_y, z)
    collision_geom(spec.worldbody, "board.panel", "box", half, where, "board", quat=facing)
    for name, y in (("left", centre_y + half_y), ("right", centre_y - half_y)):
        post = (0.02, 0.02, 0.72)
        collision_geom(
            spec.worldbody, f"board.{name}_post", "box", post, (x + 0.01, y, 0.72), "board_edge"
        )
        foot = (0.16, 0.025, 0.02)
        collision_geom(
            spec.worldbody, f"board.{name}_foot", "box", foot, (x + 0.13, y, 0.02), "board_edge"
        )
    for height in (z + half_z, z - half_z):
        rail = (0.02, half_y + 0.02, 0.02)
        visual_geom(spec.worldbody, "box", rail, (x + 0.01, centre_y, height), "board_edge")
    _decorate(spec.worldbody)


def _decorate(world: Any) -> None:
    """Add decoration: a spanner, two screwdrivers and a square."""
    front = BOARD_FRONT - 0.008
    visual_geom(world, "box", (0.004, 0.012, 0.10), (front, 0.19, 1.10), "head")
    for z in (1.00, 1.20):
        visual_geom(world, "cylinder", (0.026, 0.005), (front, 0.19, z), "head", quat=_FACING)
    for y, colour in ((0.09, "grip"), (0.03, "cart")):
        visual_geom(world, "capsule", (0.013, 0.045), (front - 0.008, y, 1.16), colour)
        visual_geom(world, "capsule", (0.004, 0.05), (front - 0.008, y, 1.06), "head")
    visual_geom(world, "box", (0.003, 0.008, 0.09), (front, 0.20, 0.82), "head")
    visual_geom(world, "box", (0.006, 0.06, 0.016), (front, 0.16, 0.74), "board_edge")
    # White outline where the hammer belongs.
    visual_geom(
        world, "box", (0.001, 0.075, 0.03), (front + 0.006, HANGER[1], HAMMER_REST), "shadow"
    )
    visual_geom(
        world, "box", (0.001, 0.026, 0.13), (front + 0.006, HANGER[1], HAMMER_REST - 0.15), "shadow"
    )


_FACING = (0.70710678, 0.0, 0.70710678, 0.0)


def _add_hanger(spec: Any) -> None:
    tip = HANGER[0] - 0.04 + _PRONG_RADIUS
    for name, y in (("left", HANGER[1] + _PRONG_GAP), ("right", HANGER[1] - _PRONG_GAP)):
        spec.worldbody.add_geom(
            name=f"hanger.{name}",
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            size=[_PRONG_RADIUS, 0.0, 0.0],
            fromto=[BOARD_FRONT, y, PRONG_HEIGHT, tip, y, PRONG_HEIGHT],
            friction=[PRONG_FRICTION.value, 0.005, 0.0001],
            material="prong",
            group=1,
            condim=4,
        )


def _add_hammer(spec: Any) -> None:
    """Add the hammer; its frame is in the middle of its head, the handle points down."""
    hammer = spec.worldbody.add_body(name=HAMMER, pos=[*HANGER, HAMMER_REST])
    hammer.add_joint(name=HAMMER_JOINT, type=mujoco.mjtJoint.mjJNT_FREE, damping=[0.0005, 0.0, 0.0])
    grip = {"friction": (HAMMER_GRIP.value, 0.005, 0.0001)}
    handle_z = -_HEAD_HALF[2] - _HANDLE_HALF[2]
    collision_geom(hammer, "hammer.head", "box", _HEAD_HALF, (0.0, 0.0, 0.0), "head", **grip)
    collision_geom(
        hammer, "hammer.handle", "box", _HANDLE_HALF, (0.0, 0.0, handle_z), "grip", **grip
    )
    visual_geom(hammer, "cylinder", (0.027, 0.012), (0.0, 0.062, 0.0), "head", quat=_ALONG_Y)
    visual_geom(hammer, "box", (0.0185, 0.0205, 0.012), (0.0, 0.0, handle_z - 0.114), "grip_end")
    visual_geom(hammer, "box", (0.0185, 0.0205, 0.004), (0.0, 0.0, handle_z + 0.08), "grip_end")
    hammer.add_site(name="hammer_grip", pos=[0.0, 0.0, -GRIP_BELOW], size=[0.005] * 3, group=4)
    head, handle = HAMMER_HEAD.value, HAMMER_HANDLE.value
    mass = head + handle
    centre = handle * handle_z / mass
    # Two boxes about their common centre of mass, on the axis through both.
    swing = head * centre**2 + handle * (handle_z - centre) ** 2
    x, y, z = (
        head * (a**2 + b**2) / 3.0 + handle * (c**2 + d**2) / 3.0
        for a, b, c, d in (
            (_HEAD_HALF[1], _HEAD_HALF[2], _HANDLE_HALF[1], _HANDLE_HALF[2]),
            (_HEAD_HALF[0], _HEAD_HALF[2], _HANDLE_HALF[0], _HANDLE_HALF[2]),
            (_HEAD_HALF[0], _HEAD_HALF[1], _HANDLE_HALF[0], _HANDLE_HALF[1]),
        )
    )
    set_mass(hammer, mass, (x + swing, y + swing, z), (0.0, 0.0, centre))


_ALONG_Y = (0.70710678, 0.70710678, 0.0, 0.0)


def _add_goal_mark(spec: Any) -> None:
    """Add corner marks on the floor at the trolley's goal."""
    for along in (-1.0, 1.0):
        for across in (-1.0, 1.0):
            x, y = PUSH_GOAL[0] + 0.36 * along, PUSH_GOAL[1] + 0.36 * across
            for half, dx, dy in (((0.09, 0.02), 0.07, 0.0), ((0.02, 0.09), 0.0, 0.07)):
                where = (x - dx * along, y - dy * across, 0.001)
                visual_geom(spec.worldbody, "box", (*half, 0.001), where, "mark")


SCENE = Scene(
    name="bench",
    doc="pegboard with a hammer on its hanger, and a trolley of 40 kg",
    build=_build,
    physics=(HAMMER_HEAD, HAMMER_HANDLE, HAMMER_GRIP, PRONG_FRICTION, *CART_QUANTITIES),
    views=(
        View((0.5, -0.55, 0.75), 35.0, -16.0, 3.1),
        View((0.6, -0.6, 0.7), -30.0, -20.0, 3.0),
        View((0.45, -0.3, 0.9), 65.0, -22.0, 1.5),
    ),
)
