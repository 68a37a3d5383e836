"""Errors of estimates: large where views like the present one are read badly."""

import numpy as np
import pytest

from lab.learning.training.errors import NEAREST, EstimationErrors


def test_an_error_is_that_on_views_of_scenes_that_are_alike() -> None:
    rng = np.random.default_rng(0)
    truth = rng.normal(size=(2000, 2)).astype(np.float32)
    # Badly seen on the right, where the first number is positive.
    scale = np.where(truth[:, :1] > 0.0, 1.0, 0.1)
    wrong = (scale * rng.normal(size=(2000, 2))).astype(np.float32)
    errors = EstimationErrors(truth, wrong)
    assert errors.overall == pytest.approx(np.sqrt(0.505), rel=0.1)
    found = errors.near(np.array([[-1.0, 0.0], [1.0, 0.0]] * 700, dtype=np.float32))
    assert found.shape == (1400, 2)
    assert found[::2] == pytest.approx(0.1, rel=0.4)
    assert found[1::2] == pytest.approx(1.0, rel=0.4)


def test_few_views_are_enough() -> None:
    truth = np.zeros((3, 1), dtype=np.float32)
    errors = EstimationErrors(truth, np.array([[1.0], [2.0], [2.0]], dtype=np.float32))
    assert len(truth) < NEAREST
    assert errors.near(np.array([[5.0]], dtype=np.float32)) == pytest.approx(np.sqrt(3.0))
    assert errors.overall == pytest.approx(np.sqrt(3.0))
