"""A wall with a door: spring lever, box latch behind a strike, hinge that opens away.

The lock is contact alone: the bolt stands behind the strike until the lever draws it back. The
leaf is in the plane x = 0.7 and opens towards +x; its hinge is on the robot's right (-y), the
lever on its left.
"""

from typing import Any, Final

import mujoco

from services.sim.scenes.base import Quantity, Scene, View
from services.sim.scenes.parts import (
    add_glow,
    add_materials,
    add_walls,
    box_inertia,
    collision_geom,
    light_from,
    set_mass,
    visual_geom,
)

HINGE_JOINT: Final = "door_hinge"
LEVER_JOINT: Final = "door_lever"
LATCH_JOINT: Final = "door_latch"
DOOR_X: Final = 0.7
"""The leaf's middle plane [m]."""
LEVER_HEIGHT: Final = 0.92
"""Of the lever's axis above the floor [m]: 10 cm above the standing robot's torso frame."""
LEVER_Y: Final = 0.35
OPENING: Final = 0.5
"""Half the width between the jambs [m], as in the public TRILL door."""

_PROTOTYPE = "prototype: 12/12 doors unlocked and walked through"
LEAF_MASS = Quantity("leaf, mass", 10.0, "kg", f"{_PROTOTYPE}; the public 0.1 kg leaf re-latches")
HINGE_DAMPING = Quantity("hinge, damping", 2.0, "N·m·s/rad", _PROTOTYPE)
HINGE_FRICTION = Quantity("hinge, dry friction", 0.5, "N·m", f"{_PROTOTYPE}; keeps the leaf ajar")
LEVER_MASS = Quantity("lever pair and spindle, mass", 0.2, "kg", "light-alloy lever handles")
LEVER_SPRING = Quantity("lever, spring", 1.0, "N·m/rad", "public TRILL door")
LEVER_PRELOAD = Quantity("lever, torque of the spring at rest", 0.3, "N·m", "holds the lever up")
LEVER_FRICTION = Quantity("lever, dry friction", 0.1, "N·m", "public TRILL door")
LEVER_DAMPING = Quantity("lever, damping", 0.02, "N·m·s/rad", "lets it come back without ringing")
LEVER_RANGE = Quantity("lever, range", 0.7, "rad", "40°, a usual lever handle")
LATCH_RATIO = Quantity("lever angle per travel of the bolt", 26.18, "rad/m", "public TRILL door")
LATCH_REACH = Quantity("bolt behind the strike", 0.015, "m", "clear at 22.5° of lever")
LATCH_MASS = Quantity("bolt, mass", 0.05, "kg", "a steel bolt")
LATCH_FRICTION = Quantity("bolt on strike, sliding friction", 0.2, "", "greased steel")
LEAF_GRIP = Quantity("leaf and lever, sliding friction", 0.8, "", "painted wood and metal")
_QUANTITIES = (
    LEAF_MASS,
    HINGE_DAMPING,
    HINGE_FRICTION,
    LEVER_MASS,
    LEVER_SPRING,
    LEVER_PRELOAD,
    LEVER_FRICTION,
    LEVER_DAMPING,
    LEVER_RANGE,
    LATCH_RATIO,
    LATCH_REACH,
    LATCH_MASS,
    LATCH_FRICTION,
    LEAF_GRIP,
)

_HINGE_RANGE = 1.75
_LEAF_HALF = (0.025, 0.485, 0.98)
_BOLT_HALF = (0.012, 0.0225, 0.015)
_FRAME: Final[dict[str, Any]] = {"contype": 4, "conaffinity": 1}
_LEAF: Final[dict[str, Any]] = {"contype": 8, "conaffinity": 1}
"""Contact bits: the robot (bit 1) collides with frame and leaf, which do not collide with each
other, for the joint is their hinge and stop."""
_BOLT_BIT = 2
"""Contact bit of bolt and strike, so that the bolt does not collide with the leaf around it."""
_STRIKE_FACE = 0.4925
_COLOURS = {
    "wall": (0.80, 0.755, 0.68, 0.05),
    "skirting": (0.93, 0.92, 0.89, 0.2),
    "frame": (0.95, 0.945, 0.925, 0.3),
    "leaf": (0.11, 0.31, 0.47, 0.35),
    "leaf_panel": (0.17, 0.40, 0.57, 0.35),
    "leaf_groove": (0.07, 0.21, 0.34, 0.1),
    "brass": (0.83, 0.66, 0.30, 0.8),
    "steel": (0.78, 0.80, 0.82, 0.9),
}


def _build(spec: Any) -> None:
    add_materials(spec, _COLOURS)
    light_from(spec, (-1.5, 1.0, 3.3), (0.4, 0.0, 0.1))
    add_glow(spec, (2.0, 1.2, 1.5), 0.4)
    _add_surroundings(spec)
    leaf = _add_leaf(spec)
    _add_lever(leaf)
    _add_latch(spec, leaf)


def _add_surroundings(spec: Any) -> None:
    add_walls(
        spec,
        {
            "wall.left": ((0.05, 1.0, 1.25), (DOOR_X, OPENING + 1.07, 1.25)),
            "wall.right": ((0.05, 1.0, 1.25), (DOOR_X, -OPENING - 1.07, 1.25)),
            "wall.top": ((0.05, OPENING + 0.07, 0.215), (DOOR_X, 0.0, 2.285)),
        },
        **_FRAME,
    )
    world = spec.worldbody
    for side, y in (("left", OPENING + 0.035), ("right", -OPENING - 0.035)):
        collision_geom(
            world, f"jamb.{side}", "box", (0.075, 0.035, 1.0), (DOOR_X, y, 1.0), "frame", **_FRAME
        )
        for front in (-1.0, 1.0):
            where = (DOOR_X + 0.062 * front, y + 1.053 * (1 if y > 0 else -1), 0.05)
            visual_geom(world, "box", (0.013, 0.995, 0.05), where, "skirting")
    collision_geom(
        world, "jamb.head", "box", (0.075, 0.57, 0.035), (DOOR_X, 0.0, 2.035), "frame", **_FRAME
    )
    # The strip the closed leaf rests against, on the robot's side: seen, and behind the joint stop.
    visual_geom(world, "box", (0.012, 0.012, 1.0), (DOOR_X - 0.045, 0.49, 1.0), "frame")
    visual_geom(world, "box", (0.012, 0.012, 1.0), (DOOR_X - 0.045, -0.49, 1.0), "frame")


def _add_leaf(spec: Any) -> Any:
    """Add the leaf; its frame is on the hinge axis at the floor."""
    leaf = spec.worldbody.add_body(name="leaf", pos=[DOOR_X, -OPENING, 0.0])
    leaf.add_joint(
        name=HINGE_JOINT,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0.0, 0.0, -1.0],
        range=[0.0, _HINGE_RANGE],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        damping=HINGE_DAMPING.value,
        frictionloss=HINGE_FRICTION.value,
    )
    centre = (0.0, OPENING, 1.0)
    set_mass(leaf, LEAF_MASS.value, box_inertia(LEAF_MASS.value, _LEAF_HALF), centre)
    grip = (LEAF_GRIP.value, 0.005, 0.0001)
    collision_geom(leaf, "leaf.board", "box", _LEAF_HALF, centre, "leaf", friction=grip, **_LEAF)
    for face in (-1.0, 1.0):
        _decorate(leaf, face)
    for height in (0.25, 1.0, 1.75):
        visual_geom(leaf, "cylinder", (0.012, 0.05), (0.03, 0.008, height), "brass")
    return leaf


def _decorate(leaf: Any, face: float) -> None:
    """Add four panels and a kick plate; ``face`` is -1 for the robot's side, 1 for the other."""
    x = face * (_LEAF_HALF[0] + 0.001)
    for y in (-0.22, 0.22):
        for z, half in ((0.52, 0.26), (1.47, 0.39)):
            visual_geom(leaf, "box", (0.002, 0.175, half), (x, OPENING + y, z), "leaf_groove")
            visual_geom(leaf, "box", (0.004, 0.155, half - 0.02), (x, OPENING + y, z), "leaf_panel")
    visual_geom(leaf, "box", (0.002, 0.46, 0.08), (x, OPENING, 0.12), "brass")


def _add_lever(leaf: Any) -> None:
    lever = leaf.add_body(name="lever", pos=[0.0, OPENING + LEVER_Y, LEVER_HEIGHT])
    lever.add_joint(
        name=LEVER_JOINT,
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[1.0, 0.0, 0.0],
        range=[0.0, LEVER_RANGE.value],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        stiffness=LEVER_SPRING.value,
        springref=-LEVER_PRELOAD.value / LEVER_SPRING.value,
        damping=LEVER_DAMPING.value,
        frictionloss=LEVER_FRICTION.value,
        armature=0.001,
    )
    set_mass(lever, LEVER_MASS.value, (0.0012, 0.0015, 0.0008), (0.0, -0.06, 0.0))
    lever.add_site(name="lever_grip", pos=[-0.1, -0.13, 0.014], size=[0.005] * 3, group=4)
    grip = (LEAF_GRIP.value, 0.005, 0.0001)
    for name, face in (("front", -1.0), ("back", 1.0)):
        collision_geom(
            lever,
            f"lever.{name}",
            "box",
            (0.012, 0.09, 0.014),
            (0.1 * face, -0.08, 0.0),
            "steel",
            friction=grip,
            **_LEAF,
        )
        visual_geom(
            lever, "cylinder", (0.0165, 0.014), (0.1 * face, 0.0, 0.0), "steel", quat=_ALONG_X
        )
        visual_geom(
            lever, "cylinder", (0.014, 0.018), (0.1 * face, -0.17, 0.0), "steel", quat=_ALONG_X
        )
        spindle = (0.0125, 0.04)
        collision_geom(
            lever, f"lever.{name}_neck", "cylinder", spindle, (0.062 * face, 0.0, 0.0), "steel",
            quat=_ALONG_X, **_LEAF,
        )  # fmt: skip
        rose = (0.028 * face, OPENING + LEVER_Y, LEVER_HEIGHT)
        visual_geom(leaf, "box", (0.004, 0.03, 0.11), (rose[0], rose[1], rose[2] - 0.05), "brass")
        visual_geom(leaf, "cylinder", (0.026, 0.006), rose, "brass", quat=_ALONG_X)


_ALONG_X = (0.70710678, 0.0, 0.70710678, 0.0)


_SLIDING_STEEL: Final[dict[str, Any]] = {
    "contype": _BOLT_BIT,
    "conaffinity": _BOLT_BIT,
    "friction": (LATCH_FRICTION.value, 0.005, 0.0001),
    "solref": (0.004, 1.0),
    "solimp": (0.95, 0.99, 0.001, 0.5, 2.0),
}


_STRIKE: Final = {**_SLIDING_STEEL, "conaffinity": _BOLT_BIT | 1}
"""The strike collides with the robot too."""


def _add_latch(spec: Any, leaf: Any) -> None:
    # Closed, the bolt's tip is LATCH_REACH behind the strike's face.
    tip = _STRIKE_FACE + LATCH_REACH.value
    bolt = leaf.add_body(name="latch", pos=[0.0, OPENING + tip - _BOLT_HALF[1], LEVER_HEIGHT])
    bolt.add_joint(
        name=LATCH_JOINT,
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0.0, -1.0, 0.0],
        range=[0.0, LEVER_RANGE.value / LATCH_RATIO.value],
        limited=mujoco.mjtLimited.mjLIMITED_TRUE,
        damping=1.0,
        armature=0.05,
    )
    set_mass(bolt, LATCH_MASS.value, box_inertia(LATCH_MASS.value, _BOLT_HALF))
    collision_geom(
        bolt, "latch.bolt", "box", _BOLT_HALF, (0.0, 0.0, 0.0), "steel", **_SLIDING_STEEL
    )
    x = DOOR_X + _BOLT_HALF[0] + 0.002 + 0.015
    half = (0.015, 0.02, 0.05)
    where = (x, _STRIKE_FACE + half[1], LEVER_HEIGHT)
    collision_geom(spec.worldbody, "strike.plate", "box", half, where, "brass", **_STRIKE)
    equality = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        name1=LATCH_JOINT,
        name2=LEVER_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        solref=[0.004, 1.0],
        solimp=[0.95, 0.99, 0.001, 0.5, 2.0],
    )
    equality.data[:5] = 0.0, 1.0 / LATCH_RATIO.value, 0.0, 0.0, 0.0


SCENE = Scene(
    name="door",
    doc="wall with a door that opens away; its lever must be pressed first",
    build=_build,
    physics=_QUANTITIES,
    views=(
        View((0.45, 0.0, 0.95), 25.0, -12.0, 3.1),
        View((0.55, 0.1, 0.95), -35.0, -18.0, 2.6),
        View((0.62, 0.2, 0.9), 65.0, -10.0, 1.35),
    ),
)
