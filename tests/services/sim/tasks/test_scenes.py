"""The scenes' mechanics: what holds, what gives way, and at what force."""

import math

import numpy as np
import pytest

from services.sim.model.world import build_model
from services.sim.scenes import SCENES
from services.sim.scenes.cap import CAN_HEIGHT
from services.sim.tasks.contacts import robot_part

from .support import Workshop


def degrees(workshop: Workshop, joint: str) -> float:
    return math.degrees(workshop.at(joint))


def test_a_locked_door_holds() -> None:
    shop = Workshop("door")
    for torque in (100.0, 300.0):
        shop.torque("door_hinge", torque)
        shop.run(0.5)
        assert 0.0 < degrees(shop, "door_hinge") < 0.5
    assert shop.at("door_lever") == pytest.approx(0.0, abs=0.01)


def test_the_lever_draws_the_bolt_and_the_door_opens_at_the_right_angle() -> None:
    shop = Workshop("door")
    shop.torque("door_hinge", 3.0)
    shop.run(0.2)
    opened_at = None
    for step in range(60):
        shop.torque("door_lever", 0.4 + 0.01 * step)
        shop.run(0.03)
        assert shop.at("door_latch") == pytest.approx(shop.at("door_lever") / 26.18, abs=5e-4)
        if shop.at("door_hinge") > math.radians(2.0):
            opened_at = degrees(shop, "door_lever")
            break
    assert opened_at is not None
    # Not before the bolt's 15 mm are drawn (22.5°); the lever moves on while the leaf starts.
    assert 22.0 < opened_at < 36.0


def test_a_lever_pressed_less_does_not_open_the_door() -> None:
    shop = Workshop("door")
    for step in range(20):
        shop.torque("door_lever", 0.03 * step)
        shop.run(0.05)
    assert 12.0 < degrees(shop, "door_lever") < 21.0
    shop.torque("door_hinge", 20.0)
    shop.run(0.5)
    assert degrees(shop, "door_hinge") < 0.5


def test_the_lever_springs_back() -> None:
    shop = Workshop("door")
    shop.torque("door_lever", 1.5)
    shop.run(0.5)
    assert degrees(shop, "door_lever") == pytest.approx(40.1, abs=0.6)
    shop.torque("door_lever", 0.0)
    shop.run(0.5)
    assert abs(degrees(shop, "door_lever")) < 0.5
    assert abs(shop.at("door_latch")) < 5e-4


def test_an_unlatched_leaf_swings_freely_and_stays_where_it_is_left() -> None:
    shop = Workshop("door")
    shop.set("door_hinge", 0.1)
    shop.run(0.3)
    assert shop.at("door_hinge") == pytest.approx(0.1, abs=1e-3)
    shop.torque("door_hinge", 2.0)
    shop.run(2.0)
    assert shop.at("door_hinge") > 0.4
    shop.torque("door_hinge", 0.0)
    shop.run(2.0)
    place = shop.at("door_hinge")
    shop.run(0.5)
    assert shop.at("door_hinge") == pytest.approx(place, abs=1e-4)


def test_a_wide_open_leaf_stays_clear_of_its_frame() -> None:
    shop = Workshop("door")
    shop.set("door_hinge", 1.7)
    shop.run(0.3)
    assert shop.at("door_hinge") == pytest.approx(1.7, abs=1e-3)


def test_the_hammer_rests_on_its_prongs() -> None:
    shop = Workshop("bench")
    shop.run(0.3)
    before, upright = shop.where("hammer"), np.array(shop.data.body("hammer").xquat)
    shop.run(5.0)
    assert np.abs(shop.where("hammer") - before).max() < 1e-4
    assert abs(upright @ shop.data.body("hammer").xquat) > 1.0 - 1e-6


def test_the_hammer_swings_but_stays_when_nudged() -> None:
    shop = Workshop("bench")
    shop.pull("hammer", (0.0, 0.3, 0.0))
    shop.run(0.2)
    shop.pull("hammer", (0.0, 0.0, 0.0))
    shop.run(1.0)
    assert shop.where("hammer")[2] > 0.9


@pytest.mark.parametrize(("force", "moves"), [(9.0, False), (13.0, True)])
def test_the_trolley_needs_about_10_newton(force: float, moves: bool) -> None:
    shop = Workshop("bench")
    shop.set("cart_x", 1.5)
    shop.pull("cart", (force, 0.0, 0.0))
    shop.run(1.0)
    assert (shop.at("cart_x") > 1.52) == moves
    # Sideways its castors hold.
    shop.pull("cart", (0.0, 2.8 * force, 0.0))
    shop.run(0.5)
    assert abs(shop.at("cart_y") + 0.72) < 2e-3


def test_the_trolley_stops_by_itself() -> None:
    shop = Workshop("bench")
    shop.set("cart_x", 1.5)
    shop.data.joint("cart_x").qvel[:] = 0.3
    shop.run(1.5)
    assert 1.55 < shop.at("cart_x") < 1.7
    assert abs(float(shop.data.joint("cart_x").qvel[0])) < 1e-3


def test_tool_and_box_stand_still() -> None:
    shop = Workshop("tool")
    shop.run(0.2)
    before = shop.where("tool"), shop.where("box")
    shop.run(2.0)
    for was, name in zip(before, ("tool", "box"), strict=True):
        assert np.abs(shop.where(name) - was).max() < 1e-4


def cap_gap(shop: Workshop) -> float:
    """How far the cap is off its seat [m]."""
    return float(shop.where("cap")[2] - shop.where("can")[2]) - CAN_HEIGHT


def test_the_cap_holds_by_itself_and_against_a_light_pull() -> None:
    shop = Workshop("cap")
    shop.run(2.0)
    assert abs(cap_gap(shop)) < 3e-4
    # The can turned over shakes no cap off: twice its weight, and more.
    shop.pull("cap", (0.0, 0.0, 3.0))
    shop.run(1.0)
    assert cap_gap(shop) < 5e-4


def test_the_cap_comes_off_at_a_plausible_force() -> None:
    shop = Workshop("cap")
    shop.run(0.2)
    force = 0.0
    while cap_gap(shop) < 0.03 and force < 100.0:
        force += 0.2
        shop.pull("cap", (0.0, 0.0, force))
        shop.pull("can", (0.0, 0.0, -force - 30.0))
        shop.run(0.01)
    assert 12.0 < force < 45.0
    # And off it stays: nothing draws it back.
    shop.pull("cap", (0.0, 0.0, 0.0))
    shop.run(0.01)
    assert cap_gap(shop) > 0.03


def test_a_can_that_nobody_holds_comes_along_with_the_cap() -> None:
    shop = Workshop("cap")
    shop.run(0.2)
    shop.pull("cap", (0.0, 0.0, 5.0))
    shop.run(0.5)
    assert shop.where("can")[2] > 0.78
    assert cap_gap(shop) < 5e-4


@pytest.mark.parametrize("name", sorted(SCENES))
def test_looks_cost_no_physics(name: str) -> None:
    full, lean = build_model(name), build_model(name, visuals=False)
    assert (full.nq, full.nv, full.nu) == (lean.nq, lean.nv, lean.nu)
    np.testing.assert_array_equal(full.body_mass, lean.body_mass)
    np.testing.assert_array_equal(full.body_inertia, lean.body_inertia)
    colliding = [g for g in range(full.ngeom) if full.geom_contype[g]]
    assert len(colliding) == lean.ngeom
    names = [lean.geom(g).name for g in range(lean.ngeom)]
    assert all(robot_part(geom) or geom == "floor" or "." in geom for geom in names), names


@pytest.mark.parametrize("name", sorted(SCENES))
def test_every_mass_in_the_table_is_that_of_the_model(name: str) -> None:
    model, table = build_model(name, visuals=False), SCENES[name].physics
    flat = build_model("flat", visuals=False)
    written = sum(row.value for row in table if row.unit == "kg")
    assert model.body_mass.sum() - flat.body_mass.sum() == pytest.approx(written)
