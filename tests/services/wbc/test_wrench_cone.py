"""The closed-form wrench cone against what four point contacts at the corners can do."""

from itertools import product

import numpy as np
import pytest
from scipy.optimize import linprog

from services.wbc.config import ContactConfig
from services.wbc.qp import CONE_ROWS, FZ, wrench_cone

from .support import Array

CONFIG = ContactConfig()


def _generators(config: ContactConfig) -> Array:
    """(16, 6) wrenches of unit normal force on an edge of each corner's friction pyramid."""
    mu, x, y = config.friction, config.half_length, config.half_width
    rows = []
    for a, b, c, d in product((1.0, -1.0), repeat=4):
        place, force = np.array([a * x, b * y, 0.0]), np.array([c * mu, d * mu, 1.0])
        rows.append(np.concatenate((force, np.cross(place, force))))
    return np.array(rows)


def test_wrenches_of_four_corner_forces_are_inside() -> None:
    rng = np.random.default_rng(0)
    cone, generators = wrench_cone(CONFIG), _generators(CONFIG)
    for _ in range(2000):
        wrench = rng.exponential(100.0, 16) * rng.integers(0, 2, 16) @ generators
        assert (cone @ wrench >= -1e-9).all()


def test_every_other_wrench_is_outside() -> None:
    """U f >= 0 just when f is a sum of corner forces: no admissible force is forgone either."""
    rng = np.random.default_rng(1)
    cone, generators = wrench_cone(CONFIG), _generators(CONFIG)
    spread = np.array([0.3, 0.3, 0.0, 0.065, 0.115, 0.054])
    inside = 0
    for _ in range(200):
        wrench = 100.0 * (spread * rng.uniform(-0.8, 0.8, 6) + np.array([0, 0, 1.0, 0, 0, 0]))
        solution = linprog(np.zeros(16), A_eq=generators.T, b_eq=wrench, bounds=(0, None))
        margin = float((cone @ wrench).min())
        assert (margin >= 0.0) == solution.success or abs(margin) < 1e-6, wrench
        inside += solution.success
    assert 40 < inside < 160  # both kinds were tried in earnest


@pytest.mark.parametrize(
    "wrench",
    [
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0],  # pulls
        [31.0, 0.0, 100.0, 0.0, 0.0, 0.0],  # slides forward, mu 0.3
        [0.0, -31.0, 100.0, 0.0, 0.0, 0.0],  # slides sideways
        [0.0, 0.0, 100.0, 6.6, 0.0, 0.0],  # tips over the long edge, half width 0.065
        [0.0, 0.0, 100.0, 0.0, -11.6, 0.0],  # tips over heel or toes, half length 0.115
        [0.0, 0.0, 100.0, 0.0, 0.0, 5.5],  # twists: mu (x + y) = 0.054 m
        [0.0, 0.0, 100.0, 0.0, 0.0, -5.5],
        [20.0, 20.0, 100.0, 0.0, 0.0, 2.0],  # twists while friction already drags
    ],
)
def test_what_a_foot_cannot_do(wrench: list[float]) -> None:
    cone = wrench_cone(CONFIG)
    assert (cone @ np.array(wrench)).min() < -1e-3
    # A little less of everything but the normal force is possible.
    eased = 0.9 * np.array(wrench)
    eased[FZ] = 100.0
    assert (cone @ eased).min() > 0.0


def test_every_row_is_a_face() -> None:
    """Each row touches the cone along at least five of its edges, and no row repeats another."""
    cone, generators = wrench_cone(CONFIG), _generators(CONFIG)
    assert cone.shape == (CONE_ROWS, 6)
    products = cone @ generators.T
    # The first row, fz >= 0, touches at the apex alone.
    assert (products[0] == 1.0).all()
    assert ((np.abs(products[1:]) < 1e-12).sum(axis=1) >= 5).all()
    scaled = cone / np.linalg.norm(cone, axis=1, keepdims=True)
    overlap = np.abs(scaled @ scaled.T) - np.eye(CONE_ROWS)
    assert overlap.max() < 0.9999


def test_cone_scales_with_the_configuration() -> None:
    slippery = wrench_cone(ContactConfig(friction=0.1))
    wrench = np.array([15.0, 0.0, 100.0, 0.0, 0.0, 0.0])
    assert (slippery @ wrench).min() < 0.0 < (wrench_cone(CONFIG) @ wrench).min()
    small = wrench_cone(ContactConfig(half_length=0.05))
    leaning = np.array([0.0, 0.0, 100.0, 0.0, 6.0, 0.0])
    assert (small @ leaning).min() < 0.0 < (wrench_cone(CONFIG) @ leaning).min()
