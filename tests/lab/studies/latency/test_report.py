import csv
import io
import json
import sys
from collections.abc import Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from rich.console import Console

from common.errors import ConfigError
from lab.cli.main import main
from lab.errors import LatencyStudyError
from lab.studies.latency.plan import Plan
from lab.studies.latency.record import StudyTrial
from lab.studies.latency.report import write_report
from lab.studies.latency.stats import summarise
from lab.studies.latency.store import SHEETS, StudyStore
from lab.studies.latency.tables import summary_table
from lab.studies.latency.tlx import write_sheet
from tests.disk import fill
from tests.lab.studies.latency.support import (
    CONDITIONS,
    HAMMER,
    PLAN,
    UNLOCK,
    WEIGHTS,
    plan_of,
    sheet,
    trial,
    trials,
)

TIMES = {"raw": 8.0, "interpolation": 8.2, "latency-250": 9.0, "latency-500": 10.0}
RED = (181, 71, 59)
"""Of trials that were no success, as RGB."""


def study(root: Path, done: Sequence[StudyTrial], plan: Plan = PLAN) -> StudyStore:
    store = StudyStore(root)
    with store.writing(plan):
        for one in done:
            store.add(one)
    return store


def picture(store: StudyStore) -> np.ndarray:
    """(h, w, 3) RGB."""
    image = cv2.imread(str(store.root / "latency.png"))
    assert image is not None
    return np.asarray(image[:, :, ::-1])


def share(image: np.ndarray, colour: tuple[int, int, int]) -> float:
    return float((np.abs(image.astype(int) - colour).max(axis=2) < 8).mean())


def test_the_files_of_a_study(tmp_path: Path) -> None:
    store = study(tmp_path, [*trials(TIMES), *trials(TIMES, task=HAMMER)])
    report = write_report(store)
    assert report is not None
    with (tmp_path / "trials.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == 2 * 4 * 6
    first = rows[0]
    assert (first["operator"], first["task"], first["condition"]) == ("synthetic", UNLOCK, "raw")
    assert (first["time_s"], first["verdict"], first["reached"]) == ("8.0", "success", "1")
    assert (first["command_asked_mean_ms"], first["command_mean_ms"]) == ("250.0", "255.0")
    with (tmp_path / "summary.csv").open() as file:
        cells = list(csv.DictReader(file))
    late = next(c for c in cells if (c["task"], c["condition"]) == (UNLOCK, "latency-500"))
    assert float(late["difference_mean"]) == pytest.approx(1.8)
    assert (late["trials"], late["difference_count"]) == ("6", "6")
    summary = json.loads((tmp_path / "summary.json").read_text())
    assert summary["reproduced"] is True
    assert [c["met"] for c in summary["comparisons"]] == [True] * 6
    assert summary["baseline"] == "interpolation"
    assert len(summary["cells"]) == 8


def test_the_figure_shows_what_there_is(tmp_path: Path) -> None:
    plan = plan_of(*CONDITIONS, tasks=(UNLOCK,))
    good = study(tmp_path / "good", trials(TIMES), plan)
    failed = [trial("latency-500", seed, 20.0, "failure") for seed in range(6)]
    kept = [t for t in trials(TIMES) if t.condition != "latency-500"]
    bad = study(tmp_path / "bad", [*kept, *failed], plan)
    for store in (good, bad):
        write_report(store)
        assert 0.02 < (picture(store) < 200).any(axis=2).mean() < 0.9
    # The legend has one mark in this colour; failures a bar, marks and the line of the limit.
    assert share(picture(bad), RED) > 0.005 > 4 * share(picture(good), RED)


def test_sheets_and_persons_stand_beside_the_synthetic_operator(tmp_path: Path) -> None:
    store = study(tmp_path, trials(TIMES))
    write_report(store)
    before = picture(store).shape
    store.add(trial("raw", 0, 12.0, operator="human", participant="P01"))
    for condition in ("raw", "latency-500"):
        write_sheet(tmp_path / SHEETS, sheet(condition, weights=WEIGHTS))
    report = write_report(store)
    assert report is not None
    assert [(c.operator, c.trials) for c in report.cells] == [("synthetic", 6)] * 4 + [("human", 1)]
    assert [(w.condition, w.raw, w.weighted) for w in report.workload] == [
        ("raw", 35.0, 37.0),
        ("latency-500", 35.0, 37.0),
    ]
    assert picture(store).shape[0] > before[0]
    with (tmp_path / "workload.csv").open() as file:
        assert [line["effort"] for line in csv.DictReader(file)] == ["60.0", "60.0"]
    with (tmp_path / "trials.csv").open() as file:
        assert [line["operator"] for line in csv.DictReader(file)].count("human") == 1


def test_only_sheets_make_a_report(tmp_path: Path) -> None:
    store = study(tmp_path, [])
    assert write_report(store) is None
    write_sheet(tmp_path / SHEETS, sheet())
    report = write_report(store)
    assert report is not None
    assert {comparison.met for comparison in report.comparisons} == {None}


def test_what_is_not_in_the_plan_is_told(tmp_path: Path) -> None:
    store = study(tmp_path, [trial("latency-1000")])
    with pytest.raises(LatencyStudyError, match="latency-1000"):
        write_report(store)


def test_without_matplotlib_it_says_what_to_install(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(__import__("sys").modules, "matplotlib", None)
    with pytest.raises(ConfigError, match="matplotlib"):
        write_report(study(tmp_path, trials(TIMES)))
    assert main(["study", "latency", "--episodes", "1", "--out", str(tmp_path)]) == 2


def test_reporting_anew_prints_the_table_and_the_conclusion(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    study(tmp_path, [*trials(TIMES), *trials(TIMES | {"latency-500": 8.5}, task=HAMMER)])
    assert main(["study", "latency", "--report", str(tmp_path)]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "synthetic" in said
    assert "NOT reproduced" in said
    assert f"{HAMMER} │ +500 ms against +250 ms │ 6 │ -0.50 [-0.50, -0.50] │ > 0.00 │ NO" in said
    assert "250: 255/260" in said


@pytest.mark.parametrize("width", [60, 190])
def test_no_figure_is_cut_off(width: int) -> None:
    console = Console(width=width, file=io.StringIO(), record=True)
    console.print(summary_table(PLAN, summarise(trials(TIMES), list(TIMES), "interpolation")))
    said = console.export_text()
    assert "…" not in said
    if width == 190:
        assert "median s [quartiles]" in said


@pytest.mark.parametrize("words", [["add", "log"], ["tlx", "--task", UNLOCK], ["latency"]])
def test_without_a_package_it_says_what_to_install_too(
    words: list[str], monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco", None)
    who = [] if words == ["latency"] else ["--participant", "P01", "--condition", "raw"]
    assert main(["study", *words, *who]) == 2
    assert "the package mujoco: pip install 'trill[study]'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("words", "code", "says"),
    [
        (["--report", "nowhere"], 1, "no study in nowhere"),
        (["--tasks", "door/fly", "--out", "x"], 2, "--tasks: unknown task 'door/fly'"),
        (["--condition", "late", "--out", "x"], 2, "standard condition"),
        (["--direction", "up", "--out", "x"], 2, "--direction"),
    ],
)
def test_wrong_options_are_explained(
    words: list[str],
    code: int,
    says: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["study", "latency", *words]) == code
    assert says in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    "wrong", [("--physics-steps", "11"), ("--seed", "-1"), ("--traits", "bored")]
)
def test_wrong_values_are_refused(
    wrong: tuple[str, str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(["study", "latency", "--out", str(tmp_path / "x"), *wrong])
    assert ended.value.code == 2
    assert wrong[0] in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_full_disk_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    store = study(tmp_path / "study", trials(TIMES))
    fill(monkeypatch)
    with pytest.raises(LatencyStudyError, match=r"No space.*--report"):
        write_report(store)
    with (
        pytest.raises(LatencyStudyError, match=r"cannot write .*No space"),
        StudyStore(tmp_path / "new").writing(PLAN),
    ):
        pass
