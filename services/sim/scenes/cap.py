"""A spray can on a stand; its cap holds by friction and comes off by hand.

Four ribs inside the cap press on the can's neck, as in real caps: the interference is elastic, and
friction holds the cap.
"""

import math
from typing import Any, Final

import mujoco

from services.sim.scenes.base import Quantity, Scene, View
from services.sim.scenes.furniture import FURNITURE_COLOURS, TABLE_QUANTITIES, TABLE_TOP, add_table
from services.sim.scenes.parts import (
    add_materials,
    add_walls,
    collision_geom,
    light_from,
    set_mass,
    visual_geom,
)

CAN: Final = "can"
CAN_JOINT: Final = "can_free"
CAP: Final = "cap"
CAP_JOINT: Final = "cap_free"
CAN_PLACE: Final = (0.40, 0.0)
"""Where the can stands (x, y) [m]: before both hands, turned inward by 30°."""
STAND_HEIGHT: Final = 0.03
CAN_REST: Final = TABLE_TOP + STAND_HEIGHT
"""Height of the can's underside [m]."""
CAN_HEIGHT: Final = 0.15
"""From the underside to the shoulder on which the cap sits [m]."""

CAN_GRIP_HEIGHT: Final = 0.065
"""Where to hold the can, above its underside [m]."""

CAN_MASS = Quantity("can, mass", 0.35, "kg", "a 400 ml can; lighter than the cap's hold is strong")
CAP_MASS = Quantity("cap, mass", 0.04, "kg", "thick plastic")
CAP_RIB = Quantity("cap, interference of each rib with the neck", 0.0008, "m", "see the hold")
CAP_STIFFNESS = Quantity("cap, reference stiffness of a rib", 7000.0, "1/s²", "see the hold")
CAP_DAMPING = Quantity("cap, reference damping of a rib", 200.0, "1/s", "little creep, little drag")
CAP_FRICTION = Quantity("cap on neck, sliding friction", 0.5, "", "plastic on metal")
CAN_GRIP = Quantity("can and cap, sliding friction", 0.6, "", "the fingers' pads have 1.5 and rule")
_RADIUS = 0.0275
_NECK = 0.021
_NECK_HALF = 0.012
_CAP_HALF = 0.026
_CAP_RADIUS = 0.025
_RIB = 0.003
_RIB_Z = 0.008
_CAP_BIT = 2
_COLOURS = {
    **FURNITURE_COLOURS,
    "can": (0.80, 0.12, 0.14, 0.7),
    "label": (0.96, 0.95, 0.92, 0.3),
    "can_metal": (0.75, 0.77, 0.80, 0.9),
    "cap": (0.10, 0.12, 0.15, 0.5),
    "cap_band": (0.97, 0.78, 0.12, 0.4),
    "stand": (0.30, 0.33, 0.37, 0.4),
}


def _build(spec: Any) -> None:
    add_materials(spec, _COLOURS)
    light_from(spec, (-1.1, 1.2, 3.3), (0.5, 0.0, 0.0))
    add_walls(spec, {"wall.back": ((0.05, 6.0, 1.6), (2.4, 0.0, 1.6))})
    visual_geom(spec.worldbody, "box", (0.01, 6.0, 0.05), (2.34, 0.0, 0.05), "skirting")
    add_table(spec)
    where = (*CAN_PLACE, TABLE_TOP + 0.5 * STAND_HEIGHT)
    collision_geom(
        spec.worldbody, "stand.block", "cylinder", (0.05, 0.5 * STAND_HEIGHT), where, "stand"
    )
    _add_can(spec)
    _add_cap(spec)


def _add_can(spec: Any) -> None:
    """Add the can; its frame is in the middle of its underside."""
    can = spec.worldbody.add_body(name=CAN, pos=[*CAN_PLACE, CAN_REST])
    can.add_joint(name=CAN_JOINT, type=mujoco.mjtJoint.mjJNT_FREE)
    half = 0.5 * CAN_HEIGHT
    grip = (CAN_GRIP.value, 0.005, 0.0001)
    collision_geom(
        can, "can.body", "cylinder", (_RADIUS, half), (0.0, 0.0, half), "can", friction=grip
    )
    neck = (0.0, 0.0, CAN_HEIGHT + _NECK_HALF)
    collision_geom(
        can, "can.neck", "cylinder", (_NECK, _NECK_HALF), neck, "can_metal", **_fit(), friction=grip
    )
    visual_geom(can, "cylinder", (_RADIUS + 0.0004, 0.030), (0.0, 0.0, 0.085), "label")
    visual_geom(can, "cylinder", (_RADIUS + 0.0006, 0.006), (0.0, 0.0, 0.085), "cap_band")
    for z in (0.003, CAN_HEIGHT - 0.003):
        visual_geom(can, "cylinder", (_RADIUS + 0.0008, 0.003), (0.0, 0.0, z), "can_metal")
    visual_geom(can, "cylinder", (0.006, 0.006), (0.0, 0.0, CAN_HEIGHT + 0.03), "label")
    can.add_site(name="can_grip", pos=[0.0, 0.0, CAN_GRIP_HEIGHT], size=[0.005] * 3, group=4)
    mass = CAN_MASS.value
    across = mass * (3 * _RADIUS**2 + CAN_HEIGHT**2) / 12.0
    set_mass(can, mass, (across, across, 0.5 * mass * _RADIUS**2), (0.0, 0.0, half))


def _add_cap(spec: Any) -> None:
    """Add the cap; its frame is in the middle of its lower edge, on the can's shoulder."""
    cap = spec.worldbody.add_body(name=CAP, pos=[*CAN_PLACE, CAN_REST + CAN_HEIGHT])
    cap.add_joint(name=CAP_JOINT, type=mujoco.mjtJoint.mjJNT_FREE)
    grip = (CAN_GRIP.value, 0.005, 0.0001)
    # From outside the cap is a full cylinder; the neck does not feel it, only the ribs.
    shell = (_CAP_RADIUS, _CAP_HALF)
    collision_geom(cap, "cap.shell", "cylinder", shell, (0.0, 0.0, _CAP_HALF), "cap", friction=grip)
    ring = _NECK + _RIB - CAP_RIB.value
    for index in range(4):
        angle = 0.25 * math.pi + 0.5 * math.pi * index
        where = (ring * math.cos(angle), ring * math.sin(angle), _RIB_Z)
        rib = collision_geom(cap, f"cap.rib{index}", "sphere", (_RIB,), where, "cap", **_fit())
        rib.friction[0] = CAP_FRICTION.value
        rib.priority = 1
    visual_geom(cap, "cylinder", (_CAP_RADIUS + 0.0006, 0.004), (0.0, 0.0, 0.006), "cap_band")
    visual_geom(
        cap, "cylinder", (_CAP_RADIUS - 0.003, 0.003), (0.0, 0.0, 2 * _CAP_HALF), "cap_band"
    )
    cap.add_site(name="cap_grip", pos=[0.0, 0.0, _CAP_HALF], size=[0.005] * 3, group=4)
    mass = CAP_MASS.value
    across = mass * (3 * _CAP_RADIUS**2 + (2 * _CAP_HALF) ** 2) / 12.0
    set_mass(cap, mass, (across, across, 0.8 * mass * _CAP_RADIUS**2), (0.0, 0.0, _CAP_HALF))


def _fit() -> dict[str, Any]:
    """Neck and ribs meet each other alone, with the elasticity of the ribs."""
    return {
        "contype": _CAP_BIT,
        "conaffinity": _CAP_BIT,
        "solref": (-CAP_STIFFNESS.value, -CAP_DAMPING.value),
        "solimp": (0.97, 0.97, 0.001, 0.5, 2.0),
    }


SCENE = Scene(
    name="cap",
    doc="spray can with a cap, on a stand",
    build=_build,
    physics=(
        *TABLE_QUANTITIES,
        CAN_MASS,
        CAP_MASS,
        CAP_RIB,
        CAP_STIFFNESS,
        CAP_DAMPING,
        CAP_FRICTION,
        CAN_GRIP,
    ),
    views=(
        View((0.30, 0.0, 0.82), -140.0, -18.0, 1.9),
        View((0.3, 0.0, 0.75), 140.0, -20.0, 2.3),
        View((0.36, 0.0, 0.90), 165.0, -22.0, 0.85),
    ),
)
