"""Many trials: what is kept is not run again, whatever happened in between."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from common.errors import TrillError
from lab.errors import LabError
from lab.studies.tasks.command import main
from lab.trials import results
from lab.trials.operators.specs import SyntheticSpec
from lab.trials.results import TrialFile, run_trial, run_trials, trial_code
from lab.trials.spec import TrialResult, TrialSpec
from lab.trials.stack import TaskStack
from lab.trials.workers import LocalExecutor
from services.teleop.synthetic.traits import TRAITS

SPEC = TrialSpec(task="door/unlock", seed=3, physics_steps=5)


def replace(spec: TrialSpec, **changes: object) -> TrialSpec:
    return spec.model_copy(update=changes)


def listener() -> tuple[list[TrialResult], Callable[[TrialSpec, TrialResult], None]]:
    told: list[TrialResult] = []
    return told, lambda _spec, found: told.append(found)


def nobody() -> LocalExecutor:
    raise AssertionError("no worker is needed")


def result(seed: int, verdict: str = "success") -> TrialResult:
    return TrialResult(
        task="door/unlock",
        seed=seed,
        verdict=verdict,
        time=7.5,
        reason="it was",
        doing="done",
        stages=("lever pressed",),
        simulated=9.0,
        wall=4.5,
        links={"command": "250ms"},
    )


def test_a_kept_trial_is_not_run_again(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    told, tell = listener()
    assert run_trials([SPEC], TrialFile(path), nobody, on_result=tell) == [result(3)]
    assert told == []


def test_a_trial_counts_only_with_the_same_settings(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    kept = TrialFile(path)
    assert kept.result(SPEC) == result(3)
    for other in (
        replace(SPEC, seed=4),
        replace(SPEC, physics_steps=1),
        replace(SPEC, links={}),
        replace(SPEC, raw_hands=True),
        replace(SPEC, operator=SyntheticSpec(traits=TRAITS["steady"])),
    ):
        assert kept.result(other) is None


def test_trials_of_other_code_do_not_count_and_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    other = trial_code(SPEC.operator).model_copy(update={"source": "another"})
    monkeypatch.setattr(results, "trial_code", lambda _operator: other)
    kept = TrialFile(path)
    assert (kept.result(SPEC), kept.other_code) == (None, 1)


def test_a_file_from_when_there_was_one_operator_is_read(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    steady = replace(SPEC, operator=SyntheticSpec(traits=TRAITS["steady"]))
    TrialFile(path).add(steady, result(3))
    line = json.loads(path.read_text())
    line["spec"]["traits"] = line["spec"].pop("operator")["traits"]
    path.write_text(json.dumps(line) + "\n")
    kept = TrialFile(path)
    assert (kept.result(steady), kept.result(SPEC)) == (result(3), None)


def test_a_torn_line_is_dropped_and_the_next_begins_on_its_own(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    kept = TrialFile(path)
    kept.add(SPEC, result(3))
    kept.add(replace(SPEC, seed=4), result(4, "failure"))
    whole = path.read_bytes()
    path.write_bytes(whole[:-30])
    again = TrialFile(path)
    assert again.result(SPEC) == result(3)
    assert again.result(replace(SPEC, seed=4)) is None
    again.add(replace(SPEC, seed=4), result(4, "failure"))
    assert path.read_bytes() == whole


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    path.write_text(json.dumps({"seed": 3}) + "\n")
    with pytest.raises(LabError, match=r"line 1 is no result"):
        TrialFile(path)


@pytest.mark.parametrize("content", [b'{"precious": 1}', b"precious", b"\xff\xfe\n", b"\xff"])
def test_a_file_that_is_not_ours_stays_as_it_is(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(LabError, match="no result"):
        TrialFile(path)
    assert path.read_bytes() == content


def test_a_line_torn_anywhere_is_ours(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    whole = path.read_bytes()
    for length in (1, 20, 60, len(whole) - 1):
        path.write_bytes(whole + whole[:length])
        kept = TrialFile(path)
        assert kept.result(SPEC) == result(3)
        kept.add(SPEC, result(3))
        assert path.read_bytes() == 2 * whole


def test_a_line_that_another_process_is_writing_is_left_to_it(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    whole = path.read_bytes()
    with path.open("ab", buffering=0) as other:
        other.write(whole[:60])
        assert TrialFile(path).result(SPEC) == result(3)
        other.write(whole[60:])
    assert path.read_bytes() == 2 * whole


def test_where_nothing_can_be_kept_is_told(tmp_path: Path) -> None:
    with pytest.raises(LabError, match="cannot"):
        TrialFile(tmp_path)
    kept = TrialFile(tmp_path / "trials.jsonl")
    (tmp_path / "trials.jsonl").mkdir()
    with pytest.raises(LabError, match="give the same command again"):
        kept.add(SPEC, result(3))


@pytest.mark.parametrize("wrong", [["--pace", "brisk"], ["--physics-steps", "0"]])
def test_wrong_options_begin_no_worker(wrong: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["run", "door/unlock", "--seeds", "0", *wrong])
    assert stop.value.code == 2


def test_trouble_is_no_wrong_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def lost(*_: object, **_options: object) -> None:
        raise TrillError("the worker was lost")

    monkeypatch.setattr("lab.trials.shown.run_trials", lost)
    assert main(["run", "door/unlock", "--seeds", "0"]) == 1
    assert "the worker was lost" in capsys.readouterr().err
    assert main(["run", "door/unlock", "--out", str(tmp_path)]) == 2


def test_a_campaign_runs_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    told, tell = listener()
    trials = [replace(SPEC, seed=0), SPEC]
    first, second = run_trials(
        trials,
        TrialFile(path),
        lambda: LocalExecutor(1),
        on_result=tell,
    )
    assert (first.seed, first.verdict, second) == (0, "success", result(3))
    assert told == [first]
    assert len(path.read_text().splitlines()) == 2


def test_a_missing_package_is_told_in_words() -> None:
    code = (
        "import sys; sys.modules['mujoco'] = None\n"
        "from lab.studies.tasks.__main__ import main\n"
        "raise SystemExit(main())\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "needs the package mujoco: pip install '.[study]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_trials_with_other_packages_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trials.jsonl"
    TrialFile(path).add(SPEC, result(3))
    other = trial_code(SPEC.operator).model_copy(update={"versions": {"mujoco": "99.0"}})
    monkeypatch.setattr(results, "trial_code", lambda _operator: other)
    kept = TrialFile(path)
    assert (kept.result(SPEC), kept.other_code) == (None, 1)


def test_a_trial_whose_simulation_fails_has_a_result(monkeypatch: pytest.MonkeyPatch) -> None:
    def fails(_stack: TaskStack, _stop: object = None) -> TrialResult:
        raise TrillError("the solver gave up")

    monkeypatch.setattr(TaskStack, "run", fails)
    found = run_trial({"synthetic": trial_code(SPEC.operator)}, SPEC)
    assert (found.verdict, found.reason) == ("error", "TrillError: the solver gave up")
