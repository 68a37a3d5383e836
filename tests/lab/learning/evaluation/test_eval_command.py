"""``trill eval`` as a user gives it."""

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest

pytest.importorskip("torch", reason="needs the extra policy")

from lab.cli.main import main
from lab.learning.evaluation.films import COLUMNS, TILE, film, film_failures, film_name
from lab.review.frames import Image
from lab.trials.results import TrialFile, read_records
from lab.trials.spec import TrialSpec
from services.sim.errors import RenderingUnavailableError
from services.sim.tasks import find_task
from tests.lab.learning.evaluation.support import checkpoint, invented, operator_of, result, trial
from tests.lab.trials.fake_executor import FakeExecutor


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return checkpoint(tmp_path_factory.mktemp("policy") / "made")


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (["--trials", "3", "--seeds", "0:3"], "--seeds or --trials, got both"),
        (["--task", "door/paint"], "--task"),
        (["--serve", "execute"], "expected NAME=VALUE"),
        (["--serve", "haste=3"], "haste"),
        (["--serve", "trigger.level=-1"], "level"),
        (["--blind", "nowhere"], "expected a folder that trill collect wrote, got nowhere"),
        (["--link", "comand=1s"], "no topic 'comand'"),
    ],
)
def test_a_wrong_option_is_told_and_nothing_runs(
    made: Path, wrong: list[str], words: str, capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:  # fmt: skip
    monkeypatch.setattr("lab.trials.shown.run_trials", lambda *_: pytest.fail("it was run"))
    assert main(["eval", str(made), *wrong]) == 2
    assert words in capsys.readouterr().err


def test_what_is_no_checkpoint_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["eval", str(tmp_path)]) == 1
    assert "cannot read config.json" in capsys.readouterr().err


def test_a_trial_is_run_once_and_compared(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out, operated = tmp_path / "eval.jsonl", tmp_path / "operator.jsonl"
    TrialFile(operated).add(TrialSpec(task="door/unlock", seed=0), result(0))
    words = ["eval", str(made), "--trials", "1", "--out", str(out), "--operator", str(operated)]
    assert main(words) == 0
    shown = capsys.readouterr()
    assert "trill, blind, chunks" in shown.out
    assert "door/unlock seed 0: failure" in shown.out
    (record,) = read_records(out)
    assert record.operator == "policy"
    assert record.result.still is not None
    before = out.read_bytes()
    assert main(words) == 0
    assert "1 of 1 trials are in" in capsys.readouterr().err
    assert out.read_bytes() == before


def test_an_operator_without_these_seeds_is_told(
    made: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    operated = tmp_path / "operator.jsonl"
    TrialFile(operated).add(TrialSpec(task="door/unlock", seed=77), result(77))
    assert main(["eval", str(made), "--trials", "1", "--operator", str(operated)]) == 2
    assert "has no success of door/unlock with these seeds" in capsys.readouterr().err


def test_a_failure_is_filmed(made: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(
        "services.sim.physics.plant.find_task", lambda name: replace(find_task(name), limit=1.0)
    )
    spec = trial(operator_of(made), 3)
    try:
        tiles = film(tmp_path, spec)
    except RenderingUnavailableError as error:
        pytest.skip(str(error))
    assert {tile.shape for tile in tiles} == {(TILE[1], TILE[0], 3)}
    assert len(tiles) == COLUMNS
    video = cv2.VideoCapture(str(tmp_path / film_name(spec)))
    assert video.get(cv2.CAP_PROP_FRAME_COUNT) > 10


def test_only_failures_are_filmed_and_only_once(tmp_path: Path) -> None:
    policy = invented("mine")
    trials = [
        (trial(policy, 0), result(0)),
        (trial(policy, 1), result(1, "failure")),
        (trial(policy, 2), result(2, "partial")),
    ]

    def drawn(spec: TrialSpec) -> list[Image]:
        (tmp_path / film_name(spec)).write_bytes(b"film")
        return [np.zeros((TILE[1], TILE[0], 3), np.uint8)] * COLUMNS

    executor = FakeExecutor(drawn)
    sheet = film_failures(trials, tmp_path, lambda: executor)
    assert [spec.seed for spec in executor.given] == [1, 2]
    assert sheet is not None
    picture = cv2.imread(str(sheet))
    assert picture is not None
    assert picture.shape[0] > 2 * TILE[1]
    again = FakeExecutor(drawn)
    assert film_failures(trials, tmp_path, lambda: again) == sheet
    assert again.given == []
    assert film_failures(trials[:1], tmp_path, lambda: again) is None
