"""The trolley of the workbench: drawers, a tray with a rim and a push bar, moving in the plane."""

from typing import Any, Final

import mujoco

from services.sim.scenes.base import Quantity
from services.sim.scenes.parts import (
    add_materials,
    box_inertia,
    collision_geom,
    set_mass,
    visual_geom,
)

CART: Final = "cart"
CART_JOINTS: Final = ("cart_x", "cart_y", "cart_yaw")
"""Slides along world x and y [m], then a turn about the vertical [rad]."""
PARKED: Final = (0.68, -0.72)
"""Where it stands unless a task says otherwise (x, y) [m]."""
BAR_OFFSET: Final = 0.40
"""From the trolley's centre to the push bar, along its -x [m]."""
TRAY_HEIGHT: Final = 0.7225
"""Of the tray's floor [m]: 10 cm below the standing robot's torso frame."""
RIM_HEIGHT: Final = TRAY_HEIGHT + 0.05
TRAY_HALF: Final = 0.28
"""Half the tray's inner side [m]."""

_PUSHED = "prototype: pushed 1 m in 8 of 8 trials"
CART_MASS = Quantity("trolley, mass", 40.0, "kg", f"{_PUSHED}; the public 200 kg in 0 of 9")
ROLLING_FRICTION = Quantity("trolley, dry friction along x", 10.0, "N", _PUSHED)
ROLLING_DAMPING = Quantity("trolley, damping along x", 10.0, "N·s/m", _PUSHED)
SIDE_FRICTION = Quantity("trolley, dry friction along y", 40.0, "N", f"{_PUSHED}; fixed castors")
SIDE_DAMPING = Quantity("trolley, damping along y", 10.0, "N·s/m", "as along x")
TURN_FRICTION = Quantity("trolley, dry friction of turning", 8.0, "N·m", _PUSHED)
TURN_DAMPING = Quantity("trolley, damping of turning", 2.0, "N·m·s/rad", "as along x, at 0.45 m")
CART_GRIP = Quantity("push bar and tray, sliding friction", 0.9, "", "rubber sleeve and mat")
CART_QUANTITIES: Final = (
    CART_MASS,
    ROLLING_FRICTION,
    ROLLING_DAMPING,
    SIDE_FRICTION,
    SIDE_DAMPING,
    TURN_FRICTION,
    TURN_DAMPING,
    CART_GRIP,
)

_COLOURS = {
    "cart": (0.06, 0.33, 0.66, 0.5),
    "drawer": (0.10, 0.42, 0.78, 0.5),
    "trim": (0.80, 0.82, 0.85, 0.8),
    "mat": (0.16, 0.17, 0.19, 0.1),
    "bar": (0.95, 0.72, 0.08, 0.4),
    "tyre": (0.07, 0.07, 0.08, 0.2),
}
_BODY_LOW = 0.15


def add_cart(spec: Any) -> None:
    """Add the trolley with its push bar towards -x; its joints are its pose in the world."""
    add_materials(spec, _COLOURS)
    cart = spec.worldbody.add_body(name=CART, pos=[*PARKED, 0.0])
    frictions = (ROLLING_FRICTION, SIDE_FRICTION, TURN_FRICTION)
    dampings = (ROLLING_DAMPING, SIDE_DAMPING, TURN_DAMPING)
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    axes = ((slide, (1, 0, 0)), (slide, (0, 1, 0)), (hinge, (0, 0, 1)))
    for name, (kind, axis), ref, friction, damping in zip(
        CART_JOINTS, axes, (*PARKED, 0.0), frictions, dampings, strict=True
    ):
        cart.add_joint(
            name=name,
            type=kind,
            axis=list(axis),
            ref=ref,
            frictionloss=friction.value,
            damping=damping.value,
        )
    inertia = box_inertia(CART_MASS.value, (0.3, 0.3, 0.275))
    set_mass(cart, CART_MASS.value, inertia, (0.0, 0.0, 0.42))
    sites = (("cart_bar", [-BAR_OFFSET, 0.0, TRAY_HEIGHT]), ("cart_tray", [0.0, 0.0, TRAY_HEIGHT]))
    for name, place in sites:
        cart.add_site(name=name, pos=place, size=[0.005] * 3, group=4)
    _add_body(cart)
    _add_tray(cart)
    _add_bar(cart)


def _add_body(cart: Any) -> None:
    half = 0.5 * (TRAY_HEIGHT - 0.012 - _BODY_LOW)
    collision_geom(cart, "cart.body", "box", (0.3, 0.3, half), (0.0, 0.0, _BODY_LOW + half), "cart")
    for face in (-1.0, 1.0):
        for row, z in enumerate((0.24, 0.37, 0.485, 0.585)):
            height = (0.062, 0.055, 0.046, 0.04)[row]
            visual_geom(cart, "box", (0.006, 0.275, height), (0.3 * face, 0.0, z), "drawer")
            pull = (0.309 * face, 0.0, z + height - 0.016)
            visual_geom(cart, "box", (0.006, 0.20, 0.006), pull, "trim")
        for side in (-1.0, 1.0):
            wheel = (0.24 * face, 0.25 * side, 0.06)
            visual_geom(cart, "cylinder", (0.06, 0.022), wheel, "tyre", quat=_ALONG_Y)
            visual_geom(cart, "cylinder", (0.028, 0.024), wheel, "trim", quat=_ALONG_Y)
            fork = (0.24 * face, 0.25 * side, 0.125)
            visual_geom(cart, "box", (0.02, 0.03, 0.025), fork, "trim")


_ALONG_Y = (0.70710678, 0.70710678, 0.0, 0.0)


def _add_tray(cart: Any) -> None:
    grip = {"friction": (CART_GRIP.value, 0.01, 0.001)}
    floor = (TRAY_HALF, TRAY_HALF, 0.006)
    collision_geom(
        cart, "cart_tray.mat", "box", floor, (0.0, 0.0, TRAY_HEIGHT - 0.006), "mat", **grip
    )
    half = 0.5 * (RIM_HEIGHT - TRAY_HEIGHT + 0.012)
    z = RIM_HEIGHT - half
    for name, x, y, size in (
        ("front", 0.29, 0.0, (0.01, 0.3, half)),
        ("back", -0.29, 0.0, (0.01, 0.3, half)),
        ("left", 0.0, 0.29, (0.28, 0.01, half)),
        ("right", 0.0, -0.29, (0.28, 0.01, half)),
    ):
        collision_geom(cart, f"cart_tray.{name}", "box", size, (x, y, z), "cart", **grip)


def _add_bar(cart: Any) -> None:
    grip = {"friction": (CART_GRIP.value, 0.01, 0.001)}
    where = (-BAR_OFFSET, 0.0, TRAY_HEIGHT)
    collision_geom(
        cart, "cart_bar.grip", "cylinder", (0.02, 0.3), where, "bar", quat=_ALONG_Y, **grip
    )
    for name, y in (("left", 0.285), ("right", -0.285)):
        arm = (-0.5 * (0.3 + BAR_OFFSET), y, TRAY_HEIGHT)
        collision_geom(cart, f"cart_bar.{name}_arm", "box", (0.06, 0.01, 0.014), arm, "trim")
        visual_geom(
            cart,
            "cylinder",
            (0.024, 0.012),
            (-BAR_OFFSET, y * 1.03, TRAY_HEIGHT),
            "tyre",
            quat=_ALONG_Y,
        )
