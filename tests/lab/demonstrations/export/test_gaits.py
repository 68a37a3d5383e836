"""Forms of the gait in the actions, and the choice of measurements."""

from pathlib import Path

import numpy as np
import pytest

from common.errors import ConfigError
from common.robot.joints import JOINT_NAMES
from lab.demonstrations.export.fields import ExportColumns, column_names, read_columns, spans
from lab.demonstrations.export.gaits import held_gaits, one_hot
from lab.demonstrations.export.selection import EpisodeSelection, open_selected, select_episodes
from tests.lab.demonstrations.export.support import make

WALK = [2, 3, 4, 5, 6, 7]


def held(requests: list[int], states: list[int]) -> list[int]:
    return [int(gait) for gait in held_gaits(np.array(requests), np.array(states))]


def test_a_gait_is_held_until_it_has_been_walked() -> None:
    states = [1, 1, *WALK, 1, 1]
    assert held([0, 5, *[0] * 8], states) == [0, 5, *[5] * 6, 0, 0]
    # One asked for while another is walked is refused; one after it is not.
    assert held([0, 5, 0, 3, *[0] * 6], states) == [0, 5, *[5] * 6, 0, 0]
    twice = [0, 5, *[0] * 6, 3, 0]
    assert held([*twice, *[0] * 8], [*states, *WALK, 1, 1]) == [
        *(0, *[5] * 7),
        *(3, 3, *[3] * 6),
        *(0, 0),
    ]


def test_a_gait_that_never_begins_is_let_go_after_a_second() -> None:
    gaits = held([4, *[0] * 40], [1] * 41)
    assert gaits == [4] * 21 + [0] * 20


def test_a_column_for_each_gait() -> None:
    table = one_hot(np.array([0, 6, 2]))
    assert table.shape == (3, 7)
    assert table.argmax(axis=1).tolist() == [0, 6, 2]
    assert table.sum(axis=1).tolist() == [1, 1, 1]


@pytest.mark.parametrize(
    ("parts", "width"),
    [
        (("hands", "grippers"), 16),
        (("controller", "grippers", "hands", "feet"), 31),
        (("hands", "grippers", "joints"), 70),
        (("velocities",), 27),
        (("feet", "hands", "grippers", "joints", "velocities", "controller"), 112),
    ],
)
def test_chosen_measurements_are_columns_of_all(
    parts: tuple[str, ...], width: int, tmp_path: Path
) -> None:
    every, some = ExportColumns(), ExportColumns(parts)
    names, chosen = column_names(every.state), column_names(some.state)
    assert len(chosen) == len(set(chosen)) == width
    source = select_episodes(EpisodeSelection((make(tmp_path / "d", ("success",), size=None),)))
    with open_selected(source.episodes[0]) as episode:
        whole, part = (read_columns(c.state, episode, slice(0, 5)) for c in (every, some))
    np.testing.assert_array_equal(part, whole[:, [names.index(name) for name in chosen]])
    assert sum(c.names != () for c in some.low_dimensional().values()) == len(
        set(some.low_dimensional())
    )
    assert sum(len(c.names) for c in some.low_dimensional().values()) == width


def test_parts_follow_each_other_without_a_gap() -> None:
    columns = ExportColumns(gait="one-hot")
    for ranges in (columns.state, columns.action):
        at = 0
        for first, end in spans(ranges).values():
            assert first == at < end
            at = end
        assert at == len(column_names(ranges))
    assert spans(columns.action)["locomotion"] == (16, 23)
    assert len(JOINT_NAMES) == spans(columns.state)["joints_sin"][1] - 30


def test_unknown_parts_are_refused() -> None:
    with pytest.raises(ConfigError, match="--state"):
        ExportColumns(("hands", "elbows"))


def test_every_text_says_of_what_it_is_the_measure_and_along_which_axes() -> None:
    columns = ExportColumns()
    for one in (*columns.state, *columns.action, *columns.low_dimensional().values()):
        assert not one.doc.startswith("measured ["), one.doc
        if "torso_link" in one.doc:
            assert "x forward, y left, z up" in one.doc
    assert all("x forward" in one.doc for one in columns.state[:4])
