"""Going on with a data set: with other code, options or seeds."""

from dataclasses import replace
from pathlib import Path

import pytest

from common.episodes.errors import EpisodeError
from common.errors import ConfigError
from lab.demonstrations.collect.collect import SeedKey, collect
from lab.demonstrations.collect.dataset import DatasetFile, read_dataset
from lab.demonstrations.collect.episode import EpisodeResult
from lab.demonstrations.collect.store import DatasetStore
from lab.errors import LabError
from lab.trials.provenance import CodeVersion
from lab.trials.workers import LocalExecutor
from tests.lab.demonstrations.collect.support import (
    CODE,
    CONFIG,
    digests,
    fake_executor,
    gather,
    made,
    seeds,
)
from tests.lab.trials.fake_executor import FakeExecutor

OTHER = CodeVersion(source="0" * 64, versions=CODE.versions)


def test_other_code_is_refused_unless_accepted(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    begun = DatasetFile(config=CONFIG, code=(OTHER,), first_seed=0)
    (tmp_path / "dataset.json").write_text(begun.model_dump_json())
    before = digests(tmp_path)
    with pytest.raises(ConfigError, match=r"accept-changes(.|\n)*source: 000000000000 \| "):
        gather(tmp_path, 2)
    assert digests(tmp_path) == before
    gather(tmp_path, 2, accept_changes=True)
    file = read_dataset(tmp_path)
    assert file is not None
    assert [code.source for code in file.code] == [OTHER.source, CODE.source]
    gather(tmp_path, 3)
    assert read_dataset(tmp_path) == file.model_copy(update={"wanted": 3})


def test_what_is_wrong_in_the_description_is_named(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    path = tmp_path / "dataset.json"
    path.write_text(path.read_text().replace('"torque_mode": "relaxed"', '"torque_mode": "lazy"'))
    with pytest.raises(EpisodeError, match=r"config\.trials\.torque_mode") as error:
        read_dataset(tmp_path)
    assert "task" not in str(error.value)


def test_a_worker_with_other_code_is_refused(tmp_path: Path) -> None:
    """In a process of its own, as a worker of a cluster may have another version."""
    with pytest.raises(LabError, match=r"runs other code(.|\n)*source: 000000000000"):
        collect(CONFIG, DatasetStore(tmp_path), lambda: LocalExecutor(1), wanted=1, code=OTHER)
    assert DatasetStore(tmp_path).files() == []


def test_another_revision_or_processor_is_no_other_code(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    before = read_dataset(tmp_path)
    assert before is not None
    for changes in ({"revision": "elsewhere"}, {"machine": "x86_64 SSE2; BLAS Prescott"}):
        gather(tmp_path, 2, code=CODE.model_copy(update=changes))
        assert read_dataset(tmp_path) == before.model_copy(update={"wanted": 2})


def test_other_settings_is_refused_with_what_differs(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    other = CONFIG.model_copy(update={"raw_hands": True})
    with pytest.raises(ConfigError, match=r"raw_hands: False \| True"):
        gather(tmp_path, 2, config=other)


def test_another_first_seed_is_refused(tmp_path: Path) -> None:
    gather(tmp_path, 1)
    with pytest.raises(ConfigError, match="begun with --seed 0, not 1"):
        gather(tmp_path, 2, first_seed=1)


def test_it_goes_on_from_the_seed_it_was_begun_with(tmp_path: Path) -> None:
    gather(tmp_path, 2, first_seed=100)
    # As after a kill: a later trial had ended, the first had not.
    (tmp_path / "episodes" / "000100.h5").unlink()
    assert seeds(gather(tmp_path, 3, fake_executor(failing={102}))) == [100, 102, 103]


def test_seeds_of_seven_digits_come_after_those_of_six(tmp_path: Path) -> None:
    gather(tmp_path, 3, first_seed=999_998)
    assert [int(path.stem) for path in DatasetStore(tmp_path).files()] == [
        999_998,
        999_999,
        1_000_000,
    ]


def test_another_kind_of_processor_is_told_once(tmp_path: Path) -> None:
    def make(key: SeedKey) -> EpisodeResult:
        result = made(key.seed)
        kind = "x86_64 AVX2" if key.seed in {2, 3} else result.meta.machine
        return replace(result, meta=result.meta.model_copy(update={"machine": kind}))

    said: list[str] = []
    gather(tmp_path, 5, FakeExecutor(make, 1, lambda _key: False), on_message=said.append)
    (told,) = [text for text in said if "kind of processor" in text]
    assert "seed 2" in told
    assert "AVX2" in told
