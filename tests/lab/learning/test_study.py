"""``trill study policies --run``: what the plans train and evaluate."""

import shlex
from pathlib import Path
from typing import get_args

import pytest

pytest.importorskip("torch", reason="needs the extra policy")

from lab.cli.main import main
from lab.learning.plans import PLANS, steps
from lab.learning.training.recipes import RecipeName
from lab.trials.results import read_records
from tests.lab.learning.training.support import dataset

UNLOCK = "door-unlock"


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return dataset(tmp_path_factory.mktemp("data") / UNLOCK, 4).parent


def options(data: Path, root: Path, *more: str) -> list[str]:
    words = ["study", "policies", str(root / "evaluations"), "--out", str(root / "report")]
    words += ["--tasks", "door/unlock", "--data", str(data), "--policies", str(root / "policies")]
    return [*words, *more]


def test_all_plans_together_have_each_policy_once(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plans = [word for plan in PLANS for word in ("--run", plan)]
    assert main(options(data, tmp_path, *plans, "--sizes", "2", "4", "5", "--show")) == 0
    lines = [shlex.split(line)[1:] for line in capsys.readouterr().out.splitlines()]
    trained = [line[line.index("--out") + 1] for line in lines if line[0] == "train"]
    evaluated = [line[1] for line in lines if line[0] == "eval"]
    assert evaluated == [f"{out}/last" for out in trained]
    begin = str(tmp_path / "policies" / UNLOCK)
    pictures = f"{begin}-trill-cpu-chunks-pictures"
    assert trained == [
        pictures,
        f"{begin}-bc-rnn-cpu-chunks-pictures",
        f"{begin}-bc-cpu-chunks-pictures",
        f"{begin}-trill-cpu-chunks-blind",
        *(f"{pictures}-{name}" for name in ("monoscopic", "no-joint-state")),
        *(f"{pictures}-{name}" for name in ("deterministic", "categorical")),
        # There are four demonstrations.
        *(f"{pictures}-{size}" for size in (2, 4)),
    ]
    assert not (tmp_path / "policies").exists()


def test_ablations_are_settings_that_training_takes(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    recipes: tuple[RecipeName, ...] = get_args(RecipeName)
    for recipe in recipes:
        for step in steps(["kinds", "ablations"], (), recipe):
            words = ["train", "door/unlock", *step.train, "--recipe", recipe, "--show"]
            assert main(words) == 0, capsys.readouterr().err


def test_policies_are_trained_evaluated_and_tabled_once(data: Path, tmp_path: Path) -> None:
    brief = ["--train", "--steps 2 --inputs scene", "--eval", "--seeds 0:1"]
    words = options(data, tmp_path, "--run", "sizes", "--sizes", "2", "3", *brief)
    names = [f"{UNLOCK}-trill-cpu-chunks-scene-{size}" for size in (2, 3)]
    files = [tmp_path / "evaluations" / f"{name}.jsonl" for name in names]
    found = []
    for _ in range(2):
        assert main(words) == 0
        found.append([file.read_bytes() for file in files])
    assert found[0] == found[1]
    assert [record.spec.seed for file in files for record in read_records(file)] == [0, 0]
    assert "## Success: oracle, chunks" in (tmp_path / "report" / "policies.md").read_text()
    assert (tmp_path / "report" / "sizes.png").stat().st_size > 1000


def test_a_missing_data_set_is_told_before_anything_is_done(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    words = options(data, tmp_path, "--run", "kinds", "--tasks", "door/unlock", "door/walk")
    assert main(words) == 1
    assert f"no data set in {data / 'door-walk'}" in capsys.readouterr().err
    assert not (tmp_path / "policies").exists()


def test_a_wrong_option_of_training_is_told(
    data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit):
        main(options(data, tmp_path, "--run", "kinds", "--train", "--recipe home-made"))
    assert "trill train: error: argument --recipe" in capsys.readouterr().err
