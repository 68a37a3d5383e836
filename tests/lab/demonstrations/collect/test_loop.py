"""Which trials are run and kept, whoever is how fast and whatever was there before."""

import errno
import random
from pathlib import Path
from typing import NoReturn

import pytest

from common.episodes.errors import EpisodeError
from common.episodes.folder import INDEX, IndexLine
from lab.demonstrations.collect.collect import CollectionProgress, collect
from lab.demonstrations.collect.store import DatasetStore
from lab.errors import LabError
from tests.lab.demonstrations.collect.support import (
    CODE,
    CONFIG,
    FAILING,
    digests,
    fake_executor,
    gather,
    made,
    meta,
    seeds,
)


def test_the_lowest_seeds_that_succeed_are_the_set_for_any_number_of_workers(
    tmp_path: Path,
) -> None:
    gather(tmp_path / "one", 7)
    kept = sorted(path.stem for path in (tmp_path / "one" / "episodes").iterdir())
    assert kept == [f"{seed:06d}" for seed in (0, 2, 3, 7, 8, 9, 10)]
    rejected = sorted(path.stem for path in (tmp_path / "one" / "rejected").iterdir())
    assert rejected == [f"{seed:06d}" for seed in (1, 4, 5, 6)]
    for jobs, haste in ((2, 1), (3, 2), (5, 3), (20, 4)):
        root = tmp_path / f"{jobs}"
        executor = fake_executor(jobs, haste=haste, together=min(jobs, 7))
        assert gather(root, 7, executor).ended
        assert digests(root) == digests(tmp_path / "one")


def test_a_set_can_be_enlarged(tmp_path: Path) -> None:
    gather(tmp_path / "whole", 9)
    gather(tmp_path / "grown", 3, fake_executor(2))
    executor = gather(tmp_path / "grown", 9, fake_executor(2))
    assert 0 not in seeds(executor)
    assert digests(tmp_path / "grown") == digests(tmp_path / "whole")


def test_what_a_killed_run_leaves_is_mended(tmp_path: Path) -> None:
    gather(tmp_path / "whole", 7)
    choose = random.Random(5)
    for attempt in range(6):
        root = tmp_path / f"{attempt}"
        gather(root, 7)
        done = DatasetStore(root).files()
        # Of the trials some are missing, one is half written, the index is cut at any byte.
        for path in choose.sample(done, choose.randint(1, len(done))):
            if choose.random() < 0.3:
                path.with_name(path.name + ".part").write_bytes(path.read_bytes()[:100])
            path.unlink()
        index = (root / INDEX).read_bytes()
        (root / INDEX).write_bytes(index[: choose.randint(0, len(index))])
        gather(root, 7, fake_executor(3, haste=attempt))
        assert digests(root) == digests(tmp_path / "whole")


def test_what_others_make_in_the_data_set_is_let_be(tmp_path: Path) -> None:
    gather(tmp_path, 2)
    # As an export has while it is made.
    export = tmp_path / ".export.part"
    (export / "data").mkdir(parents=True)
    (export / "data" / "file.part").write_text("1")
    (tmp_path / "episodes" / "000009.h5.part").write_text("")
    gather(tmp_path, 3)
    assert [path.name for path in tmp_path.rglob("*.part")] == [".export.part", "file.part"]


def test_nothing_to_do_needs_no_worker(tmp_path: Path) -> None:
    gather(tmp_path, 3)

    def none() -> NoReturn:
        raise AssertionError

    progress = collect(CONFIG, DatasetStore(tmp_path), none, wanted=3)
    assert (progress.successes, progress.resumed) == (3, 4)


def test_it_gives_up_after_so_many_trials(tmp_path: Path) -> None:
    executor = fake_executor(2, range(100))
    progress = collect(CONFIG, DatasetStore(tmp_path), lambda: executor, wanted=2, max_trials=5)
    assert not progress.complete
    assert seeds(executor) == [0, 1, 2, 3, 4]


def test_the_listener_hears_of_each_trial(tmp_path: Path) -> None:
    heard: list[int] = []

    def tell(progress: CollectionProgress, line: IndexLine | None) -> None:
        if line is not None:
            assert line.meta.seed in progress.lines
            heard.append(line.meta.seed)

    gather(tmp_path, 3, on_progress=tell)
    assert heard == [0, 1, 2, 3]


def test_a_lost_worker_costs_nothing_but_time(tmp_path: Path) -> None:
    messages: list[str] = []
    executor = fake_executor(2, failing=(), losses={1: 2, 3: 1})
    gather(tmp_path / "lost", 5, executor, on_message=messages.append)
    assert sum("runs the trial again" in text for text in messages) == 3
    gather(tmp_path / "whole", 5, fake_executor(failing=()))
    assert digests(tmp_path / "lost") == digests(tmp_path / "whole")


def test_a_trial_that_costs_every_worker_ends_it_and_what_is_done_is_kept(tmp_path: Path) -> None:
    executor = fake_executor(failing=(), losses={2: 99})
    with pytest.raises(LabError, match="seed 2 has cost 3 workers"):
        gather(tmp_path, 5, executor)
    assert executor.ended
    assert 1 in [line.meta.seed for line in DatasetStore(tmp_path).scan()]


def test_two_writers_are_refused(tmp_path: Path) -> None:
    with (
        DatasetStore(tmp_path).writing(CONFIG, CODE),
        pytest.raises(EpisodeError, match="another process"),
    ):
        gather(tmp_path, 1)


def test_the_index_is_rebuilt_from_the_files(tmp_path: Path) -> None:
    gather(tmp_path, 4, fake_executor(3))
    store = DatasetStore(tmp_path)
    before = (tmp_path / INDEX).read_bytes()
    (tmp_path / INDEX).unlink()
    with pytest.raises(EpisodeError, match="--reindex"):
        store.index()
    store.write_index(store.scan())
    assert (tmp_path / INDEX).read_bytes() == before
    assert [line.meta for line in store.index()] == [
        made(seed, "failure" if seed in FAILING else "success").meta for seed in range(8)
    ]


def test_damaged_and_foreign_files_are_all_named(tmp_path: Path) -> None:
    gather(tmp_path, 3)
    episodes = tmp_path / "episodes"
    path = episodes / "000000.h5"
    path.write_bytes(path.read_bytes()[:500])
    (episodes / "000002.h5").write_bytes(b"garbage")
    (episodes / "000009.h5").write_bytes((episodes / "000003.h5").read_bytes())
    about = meta(20, "failure")
    foreign = about.origin | {"pace": "fast"}
    text = about.model_copy(update={"origin": foreign}).model_dump_json()
    (tmp_path / "rejected" / "000020.json").write_text(text)
    before = digests(tmp_path)
    with pytest.raises(EpisodeError) as error:
        gather(tmp_path, 3)
    for words in ("000000", "000002", "000009.h5: expected", "pace:  | fast"):
        assert words in str(error.value)
    assert digests(tmp_path) == before


def test_a_full_disk_is_told_and_nothing_is_lost(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    written: list[int] = []

    def full(descriptor: int) -> None:
        written.append(descriptor)
        if len(written) > 4:
            raise OSError(errno.ENOSPC, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr("common.files.os.fsync", full)
        with pytest.raises(EpisodeError, match="No space left on device; make room"):
            gather(tmp_path / "full", 7)
    assert not list((tmp_path / "full").rglob("*.part"))
    gather(tmp_path / "full", 7)
    gather(tmp_path / "whole", 7)
    assert digests(tmp_path / "full") == digests(tmp_path / "whole")


def test_what_cannot_fit_is_refused_before_anything_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("lab.demonstrations.collect.space.free", lambda _path: 60e6)
    with pytest.raises(EpisodeError, match="the disk is too small"):
        gather(tmp_path / "new", 1000)
    assert not (tmp_path / "new").exists()
    gather(tmp_path / "some", 3)
    # Invented episodes are small: measured, they fit where guessed they did not.
    gather(tmp_path / "some", 40)


def test_a_place_where_nothing_can_be_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(EpisodeError, match="choose another --out"):
        gather(tmp_path / "file", 1)
    with pytest.raises(EpisodeError, match="choose another --out"):
        gather(tmp_path / "file" / "below", 1)
