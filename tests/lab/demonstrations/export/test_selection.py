"""Which episodes are exported, which of their frames, and what is refused."""

import errno
import json
import shutil
from pathlib import Path

import h5py
import pytest

from common.episodes.errors import EpisodeError
from lab.cli.main import main
from lab.demonstrations.export.selection import EpisodeSelection, open_selected, select_episodes
from lab.errors import DatasetError
from tests.lab.demonstrations.export.support import FRAMES, SIZE, VERDICT, make, rows

MIXED = ("success", "failure", "success", "partial", "success")


def taken(choice: EpisodeSelection) -> list[int]:
    return [chosen.meta.seed for chosen in select_episodes(choice).episodes]


def test_successes_unless_others_are_asked_for(tmp_path: Path) -> None:
    roots = (make(tmp_path / "d", MIXED),)
    assert taken(EpisodeSelection(roots)) == [0, 2, 4]
    assert taken(EpisodeSelection(roots, failures=True)) == [0, 1, 2, 3, 4]
    assert taken(EpisodeSelection(roots, seeds=(1, 4))) == [2]
    assert taken(EpisodeSelection(roots, seeds=(None, 2), failures=True)) == [0, 1]
    failed = select_episodes(EpisodeSelection(roots, seeds=(1, 2), failures=True)).episodes[0]
    assert not failed.rewards().any()


def test_frames_end_with_the_verdict_unless_the_tail_is_asked_for(tmp_path: Path) -> None:
    roots = (make(tmp_path / "d", ("success",)),)
    (short,), (long,) = (
        select_episodes(EpisodeSelection(roots, tail=tail)).episodes for tail in (False, True)
    )
    assert (short.frames, long.frames) == (VERDICT, FRAMES)
    assert short.rewards().tolist() == [0.0] * (VERDICT - 1) + [1.0]
    assert long.rewards().tolist() == [0.0] * (VERDICT - 1) + [1.0] * (FRAMES - VERDICT + 1)


@pytest.mark.parametrize(
    ("width", "height", "expected"),
    [(None, None, SIZE), (24, None, (24, 16)), (None, 16, (24, 16)), (40, 40, (40, 40))],
)
def test_sizes(
    width: int | None, height: int | None, expected: tuple[int, int], tmp_path: Path
) -> None:
    roots = (make(tmp_path / "d", ("success",)),)
    source = select_episodes(EpisodeSelection(roots, width=width, height=height))
    assert source.size == expected
    assert source.resized == (expected != SIZE)
    with open_selected(source.episodes[0]) as episode:
        assert source.picture(episode, "left", 0).shape == (expected[1], expected[0], 3)
    assert select_episodes(EpisodeSelection(roots, pictures=False)).size is None


def test_sets_of_different_sizes_need_a_common_one(tmp_path: Path) -> None:
    roots = (make(tmp_path / "a", ("success",)), make(tmp_path / "b", ("success",), size=(64, 64)))
    with pytest.raises(DatasetError, match="48x32, 64x64"):
        select_episodes(EpisodeSelection(roots, width=32))
    assert select_episodes(EpisodeSelection(roots, width=32, height=32)).size == (32, 32)
    assert select_episodes(EpisodeSelection(roots, pictures=False)).size is None
    blind = (*roots, make(tmp_path / "c", ("success",), size=None))
    with pytest.raises(DatasetError, match="none"):
        select_episodes(EpisodeSelection(blind, width=32, height=32))


def test_what_cannot_be_exported_is_told(tmp_path: Path) -> None:
    with pytest.raises(DatasetError, match="trill collect"):
        select_episodes(EpisodeSelection((tmp_path,)))
    failed = make(tmp_path / "d", ("failure",))
    with pytest.raises(DatasetError, match="--failures"):
        select_episodes(EpisodeSelection((failed,)))
    with pytest.raises(DatasetError, match="with seeds 3:"):
        select_episodes(EpisodeSelection((failed,), seeds=(3, None), failures=True))
    blind = make(tmp_path / "b", ("success",), size=None)
    assert select_episodes(EpisodeSelection((blind,))).size is None
    with pytest.raises(DatasetError, match="no pictures"):
        select_episodes(EpisodeSelection((blind,), width=20))


def test_a_gap_in_time_is_refused(tmp_path: Path) -> None:
    given = rows(0)
    given.rows["time/robot_ns"][5:] = [
        int(str(t)) + 30_000_000 for t in given.rows["time/robot_ns"][5:]
    ]
    source = select_episodes(
        EpisodeSelection((make(tmp_path / "d", ("success",), rows_of={0: given}),))
    )
    with (
        pytest.raises(DatasetError, match=r"frame 5 is \+30\.0 ms off"),
        open_selected(source.episodes[0]),
    ):
        pass


def test_robot_time_in_steps_that_do_not_fit_is_no_gap(tmp_path: Path) -> None:
    given = rows(0)
    # Frames every 50 ms see a robot time that goes in steps of 3 ms.
    given.rows["time/robot_ns"] = [
        (1050 + 50 * frame) // 3 * 3_000_000 for frame in range(len(given))
    ]
    for steps, name in ((3, "a"), (1, "b")):
        root = make(tmp_path / name, ("success",), rows_of={0: given}, physics_steps=steps)
        (chosen,) = select_episodes(EpisodeSelection((root,))).episodes
        if steps == 1:
            with pytest.raises(DatasetError, match=r"2\.0 ms off"), open_selected(chosen):
                pass
        else:
            with open_selected(chosen) as episode:
                assert episode.meta.frames == FRAMES


def test_an_episode_is_not_taken_twice(tmp_path: Path) -> None:
    root = make(tmp_path / "d")
    link = tmp_path / "again"
    link.symlink_to(root)
    copy = shutil.copytree(root, tmp_path / "copy")
    for other in (root, link, copy):
        with pytest.raises(DatasetError, match="the same episode"):
            select_episodes(EpisodeSelection((root, other)))
    late = make(tmp_path / "late", physics_steps=5)
    assert len(select_episodes(EpisodeSelection((root, late))).episodes) == 6


def test_a_damaged_episode_is_told(tmp_path: Path) -> None:
    root = make(tmp_path / "d")
    with h5py.File(root / "episodes" / "000001.h5", "r+") as file:
        del file.attrs["meta"]
    with pytest.raises(EpisodeError, match=r"000001\.h5 as an episode, it is damaged"):
        select_episodes(EpisodeSelection((root,)))


def damaged(root: Path, name: str) -> None:
    """Take an array of the second episode away, as h5py finds it where bytes are wrong."""
    with h5py.File(root / "episodes" / "000001.h5", "r+") as file:
        del file[name]


@pytest.mark.parametrize("name", ["time/robot_ns", "action/hands"])
@pytest.mark.parametrize("form", ["lerobot", "robomimic"])
def test_damage_found_while_exporting_is_told(
    form: str, name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damaged(make(tmp_path / "d", size=None), name)
    assert main(["dataset", "export", str(tmp_path / "d"), "--format", form]) == 1
    said = capsys.readouterr().err
    assert "000001.h5 cannot be exported" in said
    assert "trill collect --check" in said
    assert [path.name for path in tmp_path.iterdir()] == ["d"]


def test_damage_found_while_drawing_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = make(tmp_path / "d")
    damaged(root, "images/left/data")
    given = ["collect", "--info", str(root), "--sheet", str(tmp_path / "s.png"), "--episode", "1"]
    assert main(given) == 1
    assert "it is damaged" in capsys.readouterr().err


def test_a_set_that_is_not_finished_is_told(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = make(tmp_path / "d", MIXED, size=None)
    about = json.loads((root / "dataset.json").read_text())
    for wanted, notes in ((0, 0), (3, 0), (250, 1)):
        (root / "dataset.json").write_text(json.dumps(about | {"wanted": wanted}))
        assert len(select_episodes(EpisodeSelection((root,), seeds=(0, 1))).notes) == notes
    assert main(["dataset", "export", str(root), "--format", "robomimic"]) == 0
    assert "3 of 250 successes" in capsys.readouterr().err


def test_a_full_disk_is_not_taken_for_a_damaged_episode(tmp_path: Path) -> None:
    source = select_episodes(EpisodeSelection((make(tmp_path / "d", ("success",)),)))
    with pytest.raises(OSError, match="full"), open_selected(source.episodes[0]):
        raise OSError(errno.ENOSPC, "disk full")
