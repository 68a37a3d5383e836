"""Plots as images."""

from math import pi

import numpy as np
import pytest

from common.errors import ConfigError
from common.schemas import Gait
from common.topics import PLANT_TRUTH
from lab.review.figure import new_figure
from lab.review.path_plot import plot_path
from lab.review.timeline import read_timeline
from services.wbc.config import GaitConfig
from tests.lab.review.synthetic import FakeRobot


def test_the_path_plot_shows_commanded_and_walked_apart() -> None:
    robot = FakeRobot()
    gait = robot.gait(0, Gait.FORWARD, (0, 0, pi / 2), (0, 0.1, pi / 2))
    timeline = read_timeline([robot.settings(GaitConfig(forward_step=0.4)), *gait])
    image = plot_path(timeline, 480, 270)
    assert image.shape == (270, 480, 3)
    lower = image[100:].astype(int)  # below the legend
    orange = np.all(np.abs(lower - (214, 96, 30)) < 40, axis=2)
    blue = np.all(np.abs(lower - (20, 80, 170)) < 40, axis=2)
    # Heading along +y, which is to the left: the commanded end lies further left than the walked.
    assert np.nonzero(orange)[1].min() < np.nonzero(blue)[1].min() - 20


def test_a_robot_that_stands_has_a_path_plot_too() -> None:
    timeline = read_timeline([FakeRobot().plant(PLANT_TRUTH, 0, 0, 0)])
    assert plot_path(timeline, 480, 270).shape == (270, 480, 3)


def test_without_matplotlib_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(ConfigError, match=r"\.\[deploy\]"):
        new_figure(100, 100)
