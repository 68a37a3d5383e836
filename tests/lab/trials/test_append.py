"""A result is appended in the same work, however many a campaign's store holds already."""

from collections.abc import Callable
from pathlib import Path

import pytest

from common.episodes.folder import INDEX
from lab.demonstrations.collect.store import DatasetStore
from lab.studies.latency.store import HUMAN, TRIALS, StudyStore
from lab.trials.results import TrialFile
from tests.lab.demonstrations.collect.support import meta
from tests.lab.studies.latency.support import trial
from tests.lab.trials.test_results import SPEC, result

ROWS = (10, 1_000, 100_000)
_ROW = b'{"row": "' + 88 * b"x" + b'"}\n'
_BLOCK = 4096
"""A store looks for a torn last line in the file's last block only [bytes]."""
_OTHERS = 1024
"""The counters themselves are read too [bytes]."""


def bytes_moved() -> dict[str, int]:
    """The bytes that this process has asked the system to read and to write."""
    lines = Path("/proc/self/io").read_text().splitlines()
    counters = dict(line.split(": ") for line in lines)
    return {name: int(counters[name]) for name in ("rchar", "wchar")}


def trial_file(root: Path) -> tuple[Path, Callable[[], object]]:
    path = root / "trials.jsonl"
    kept = TrialFile(path)
    return path, lambda: kept.add(SPEC, result(3))


def study(root: Path) -> tuple[Path, Callable[[], object]]:
    return root / TRIALS, lambda: StudyStore(root).add(trial())


def study_of_persons(root: Path) -> tuple[Path, Callable[[], object]]:
    person = trial(operator="human", participant="P01")

    def add() -> None:
        with StudyStore(root).adding() as append:
            append(person)

    return root / HUMAN, add


def data_set(root: Path) -> tuple[Path, Callable[[], object]]:
    for folder in ("episodes", "rejected"):
        (root / folder).mkdir()
    return root / INDEX, lambda: DatasetStore(root).add(meta(7, "failure"), None)


@pytest.mark.parametrize("begin", [trial_file, study, study_of_persons, data_set])
def test_a_result_costs_the_same_however_many_there_are(
    tmp_path: Path, begin: Callable[[Path], tuple[Path, Callable[[], object]]]
) -> None:
    written = set()
    # The first result of a process also reads modules that are imported where they are needed.
    (tmp_path / "first").mkdir()
    begin(tmp_path / "first")[1]()
    for rows in ROWS:
        root = tmp_path / str(rows)
        root.mkdir()
        path, add = begin(root)
        path.write_bytes(rows * _ROW)
        before = bytes_moved()
        add()
        after = bytes_moved()
        lines = path.read_bytes().splitlines(keepends=True)
        assert lines[:-1] == rows * [_ROW]
        assert after["rchar"] - before["rchar"] <= _BLOCK + _OTHERS
        written.add(after["wchar"] - before["wchar"])
    assert len(written) == 1
