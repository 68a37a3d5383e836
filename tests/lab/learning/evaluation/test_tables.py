"""``trill study policies``: what the tables say of files of invented trials."""

from pathlib import Path

import cv2
import pytest

from lab.cli.main import main
from lab.learning.evaluation.paper import PAPER
from lab.trials.operators.specs import StillPictures
from lab.trials.results import TrialFile, trial_code
from lab.trials.spec import TrialSpec
from tests.lab.learning.evaluation.support import invented, result, trial

CHUNKS = {"kind": "chunks"}


def row(text: str, beginning: str) -> str:
    (found,) = (line for line in text.splitlines() if line.startswith(beginning))
    return found


@pytest.fixture
def files(tmp_path: Path) -> Path:
    kept = TrialFile(tmp_path / "results" / "policies.jsonl")
    small, large = invented("trill", 30), invented("trill", 120)
    mono = invented("trill, monoscopic", 120, inputs={"vision": "monoscopic"})
    reactive, told = invented("bc", 120, kind="bc"), invented("mine", 120, actions=CHUNKS)
    unseeing = invented("trill, blind", 120, inputs={"vision": "blind"})
    still = StillPictures(file="mean.png", sha256="0")
    for seed in range(4):
        kept.add(trial(small, seed), result(seed, "success" if seed < 1 else "failure"))
        kept.add(trial(large, seed), result(seed, "success" if seed < 3 else "partial"))
        kept.add(trial(mono, seed), result(seed, "success" if seed < 2 else "failure"))
    for other in (unseeing, told, reactive):
        kept.add(trial(other), result(0, "failure"))
    # Nothing was evaluated there that a blind policy could be compared with.
    elsewhere = trial(unseeing).model_copy(update={"task": "door/walk"})
    kept.add(elsewhere, result(0, "failure", task="door/walk"))
    blind = large.model_copy(update={"pictures": still, "label": "trill, mean pictures"})
    kept.add(trial(blind), result(0, "failure", still=4.0))
    TrialFile(tmp_path / "results" / "operator.jsonl").add(
        TrialSpec(task="door/unlock", seed=0), result(0)
    )
    return tmp_path / "results"


def test_the_tables_stand_beside_the_papers(
    files: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "report"
    assert main(["study", "policies", str(files), "--out", str(out)]) == 0
    text = (out / "policies.md").read_text()
    assert text in capsys.readouterr().out
    assert "versions of the code" not in text
    assert "Demonstrations learned from: door/unlock 30, 120; door/walk 120." in text
    success, _, rest = text.partition("## Ablations: as published")
    ablations, _, rest = rest.partition("## Success: chunks")
    chunks, _, everything = rest.partition("## All rows")
    columns = ["bc", "trill", "trill, blind", "trill, mean pictures"]
    columns += ["operator (synthetic, practised)", "paper: bc", "paper: bc-rnn", "paper: trill"]
    assert row(success, "| task |") == f"| task | {' | '.join(columns)} |"
    assert "| door/walk |" not in success + chunks
    assert "| door/walk |" in everything
    cells = row(success, "| door/unlock |").split(" | ")
    # The policy of 120 demonstrations, not that of 30.
    assert cells[2] == "75 [30, 95] (100) n: 4"
    assert cells[-3:] == ["48 (52)", "80 (96)", "92 (100) |"]
    assert "paper: trill, categorical" in row(ablations, "| task |")
    assert row(ablations, "| task |").startswith("| task | trill | trill, monoscopic | paper:")
    assert "56 (84)" in row(ablations, "| door/unlock |")
    assert row(chunks, "| task |").startswith("| task | mine | operator")
    assert "| 30 | 25 [5, 70] (25) n: 4 |" in everything


def test_figures_show_what_was_measured(files: Path, tmp_path: Path) -> None:
    assert main(["study", "policies", str(files), "--out", str(tmp_path)]) == 0
    names = {path.name for path in tmp_path.glob("*.png")}
    assert names == {
        "kinds-as-published.png", "ablations-as-published.png", "kinds-chunks.png", "sizes.png",
    }  # fmt: skip
    for name in names:
        picture = cv2.imread(str(tmp_path / name))
        assert picture is not None
        assert picture.std() > 5.0


def test_several_trainings_of_one_policy_are_pooled_and_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    kept = TrialFile(tmp_path / "a.jsonl")
    for digest in ("1", "2"):
        operator = invented("trill").model_copy(update={"digest": digest})
        kept.add(trial(operator), result(0))
    words = ["study", "policies", str(tmp_path / "a.jsonl"), "--out", str(tmp_path)]
    assert main(words) == 0
    assert "n: 2 of 2 checkpoints" in capsys.readouterr().out


def test_trials_of_several_versions_of_the_code_are_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = TrialFile(tmp_path / "a.jsonl")
    kept.add(trial(invented("trill"), 0), result(0))
    other = trial_code(invented("trill")).model_copy(update={"source": "f" * 64})
    monkeypatch.setattr("lab.trials.results.trial_code", lambda _operator: other)
    kept.add(trial(invented("trill"), 1), result(1))
    assert main(["study", "policies", str(tmp_path), "--out", str(tmp_path)]) == 0
    assert "run by 2 versions of the code" in capsys.readouterr().out


@pytest.mark.parametrize("name", ["nowhere", "nowhere.jsonl"])
def test_no_results_are_told(name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["study", "policies", str(tmp_path / name)]) == 2
    assert "expected files of results" in capsys.readouterr().err


def test_another_file_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "a.jsonl").write_text('{"mine": 1}\n')
    assert main(["study", "policies", str(tmp_path)]) == 1
    assert "is no result of this command" in capsys.readouterr().err


def test_the_papers_figures_are_shares_of_25_trials() -> None:
    rates = [rate for tasks in PAPER.values() for rate in tasks.values()]
    assert len(rates) == 42
    assert all(0 <= rate.success <= rate.partial <= 100 for rate in rates)
    assert all(number % 4 == 0 for rate in rates for number in rate)
