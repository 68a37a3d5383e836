"""Going on with a data set: with other code, options or seeds."""

import json
from pathlib import Path

import pytest

from common.episodes.errors import EpisodeError
from common.errors import ConfigError
from lab.demonstrations.collect.collect import collect
from lab.demonstrations.collect.dataset import Build, DatasetFile, read_dataset
from lab.demonstrations.collect.store import Store
from tests.lab.demonstrations.collect.support import FAILING, RECIPE, FakeCrew, digests, gather

OTHER = Build(source="0" * 64, versions=Build.here().versions)


def test_other_code_is_refused_unless_accepted(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    (tmp_path / "dataset.json").write_bytes(DatasetFile(recipe=RECIPE, builds=(OTHER,)).content())
    before = digests(tmp_path)
    with pytest.raises(ConfigError, match=r"accept-changes(.|\n)*source: 000000000000 \| "):
        gather(tmp_path, 2)
    assert digests(tmp_path) == before
    collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, FAILING), wanted=2, accept_changes=True)
    file = read_dataset(tmp_path)
    assert file is not None
    assert [build.source for build in file.builds] == [OTHER.source, Build.here().source]
    gather(tmp_path, 3)
    assert read_dataset(tmp_path) == file


def test_a_data_set_of_before_builds_were_kept_is_of_unknown_code(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    (tmp_path / "dataset.json").write_text(RECIPE.model_dump_json())
    assert len(Store(tmp_path).scan()) == 1
    with pytest.raises(ConfigError, match="unknown"):
        gather(tmp_path, 2)


def test_what_is_wrong_in_the_description_is_named(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    path = tmp_path / "dataset.json"
    path.write_text(path.read_text().replace('"torque_mode": "relaxed"', '"torque_mode": "lazy"'))
    with pytest.raises(EpisodeError, match=r"recipe\.torque_mode") as error:
        read_dataset(tmp_path)
    assert "task" not in str(error.value)


def test_a_worker_with_other_code_is_refused(tmp_path: Path) -> None:
    with pytest.raises(EpisodeError, match="runs other code"):
        collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=1, build=OTHER)
    assert Store(tmp_path).files() == []


def test_another_revision_of_the_same_source_is_no_change(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    before = (tmp_path / "dataset.json").read_bytes()
    build = Build.here().model_copy(update={"revision": "elsewhere"})
    collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, FAILING), wanted=2, build=build)
    assert (tmp_path / "dataset.json").read_bytes() == before


def test_another_recipe_is_refused_with_what_differs(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    other = RECIPE.model_copy(update={"raw_hands": True})
    with pytest.raises(ConfigError, match=r"raw_hands: False \| True"):
        collect(other, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=2)


def test_another_first_seed_is_refused(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    with pytest.raises(ConfigError, match="begun with --seed 0, not 1"):
        collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=2, first_seed=1)


def test_it_goes_on_from_the_seed_it_was_begun_with(tmp_path: Path) -> None:
    collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=2, first_seed=100)
    # As after a kill: a later trial had ended, the first had not.
    (tmp_path / "episodes" / "000100.h5").unlink()
    crew = FakeCrew(1, {102})
    collect(RECIPE, Store(tmp_path), lambda: crew, wanted=3)
    assert crew.given == [100, 102, 103]


def undated(root: Path) -> None:
    """Let the description be of an earlier version, which did not say the first seed."""
    path = root / "dataset.json"
    about = json.loads(path.read_text())
    del about["first_seed"]
    path.write_text(json.dumps(about))


def test_a_set_that_does_not_say_its_first_seed_has_begun_with_0(tmp_path: Path) -> None:
    gather(tmp_path, 2)
    undated(tmp_path)
    assert gather(tmp_path, 3).given == [3]
    assert json.loads((tmp_path / "dataset.json").read_text())["first_seed"] == 0


def test_where_the_first_seed_can_only_be_guessed_it_is_asked_for(tmp_path: Path) -> None:
    collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=3)
    undated(tmp_path)
    # As after a kill: a later trial had ended, the first had not, and there is no index yet.
    (tmp_path / "episodes" / "000000.h5").unlink()
    (tmp_path / "index.jsonl").unlink()
    with pytest.raises(ConfigError, match="none before 1: give --seed"):
        collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=3)
    crew = FakeCrew(1, set())
    collect(RECIPE, Store(tmp_path), lambda: crew, wanted=3, first_seed=0)
    assert crew.given == [0]
    with pytest.raises(ConfigError, match="begun with --seed 0, not 1"):
        collect(RECIPE, Store(tmp_path), lambda: crew, wanted=3, first_seed=1)


def test_the_index_knows_a_first_trial_whose_file_is_gone(tmp_path: Path) -> None:
    collect(RECIPE, Store(tmp_path), lambda: FakeCrew(1, set()), wanted=3)
    undated(tmp_path)
    (tmp_path / "episodes" / "000000.h5").unlink()
    crew = FakeCrew(1, set())
    collect(RECIPE, Store(tmp_path), lambda: crew, wanted=3)
    assert crew.given == [0]


def test_seeds_of_seven_digits_come_after_those_of_six(tmp_path: Path) -> None:
    store = Store(tmp_path)
    collect(RECIPE, store, lambda: FakeCrew(1, set()), wanted=3, first_seed=999_998)
    assert [int(path.stem) for path in store.files()] == [999_998, 999_999, 1_000_000]
