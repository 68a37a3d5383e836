"""Messages that are kept in a file come back as they were."""

import tempfile
from pathlib import Path

import numpy as np
import pytest

from common.errors import TrillError
from common.schemas import PlantState
from common.topics import PLANT_TRUTH
from lab.review import message_spool
from lab.review.message_spool import MessageSpool
from tests.lab.review.synthetic import FakeRobot


def states(count: int) -> list[PlantState]:
    robot, made = FakeRobot(), []
    for number in range(count):
        robot.now += 10
        _, state = robot.plant(PLANT_TRUTH, 0.01 * number, -0.02 * number, 0.001 * number)
        assert isinstance(state, PlantState)
        made.append(state)
    return made


def equal(one: PlantState, other: PlantState) -> bool:
    return one.header == other.header and np.array_equal(one.base_position, other.base_position)


def test_messages_slices_and_slices_of_slices_come_back(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(message_spool, "_IN_MEMORY", 1000)
    made = states(300)
    spool = MessageSpool(PlantState, made)
    assert all(map(equal, spool, made))
    assert equal(spool[-1], made[-1])
    part = spool[::2][10:]
    assert len(part) == 140
    part.append(made[7])
    assert all(map(equal, part, [*made[20::2], made[7]]))
    assert len(spool) == 300
    with pytest.raises(IndexError):
        spool[300]


def test_an_unusable_directory_is_named(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setattr(message_spool, "_IN_MEMORY", 1)
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path / "none"))
    with pytest.raises(TrillError, match="TMPDIR"):
        MessageSpool(PlantState, states(1))
