"""Many trials: what is kept is not run again, whatever happened in between."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import ConfigError, TrillError
from lab.studies.tasks.command import main
from lab.trials import campaign
from lab.trials.campaign import ResultStore, run_campaign
from lab.trials.stack import TrialResult, TrialSpec

SPEC = TrialSpec("door/unlock", 3, physics_steps=5)


def result(seed: int, verdict: str = "success") -> TrialResult:
    return TrialResult(
        *("door/unlock", seed, verdict, 7.5, "it was", "", "done", ("lever pressed",), 9.0, 4.5),
        links={"command": "250ms"},
    )


def test_a_kept_trial_is_not_run_again(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    told: list[TrialResult] = []
    # With the trial kept no worker is begun.
    assert run_campaign([SPEC], ResultStore(path), 2, told.append) == [result(3)]
    assert told == []


def test_a_trial_counts_only_with_the_same_settings(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    kept = ResultStore(path)
    assert kept.of(SPEC) == result(3)
    for other in (
        replace(SPEC, seed=4),
        replace(SPEC, physics_steps=1),
        replace(SPEC, links={}),
        replace(SPEC, raw_hands=True),
        replace(SPEC, traits=SPEC.traits.model_copy(update={"tremor": 0.0})),
    ):
        assert kept.of(other) is None


def test_trials_of_other_code_do_not_count_and_are_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    monkeypatch.setattr(campaign, "digest", lambda _root: "another")
    kept = ResultStore(path)
    assert (kept.of(SPEC), kept.strange) == (None, 1)


def test_a_torn_line_is_dropped_and_the_next_begins_on_its_own(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    kept = ResultStore(path)
    kept.add(SPEC, result(3))
    kept.add(replace(SPEC, seed=4), result(4, "failure"))
    whole = path.read_bytes()
    path.write_bytes(whole[:-30])
    again = ResultStore(path)
    assert again.of(SPEC) == result(3)
    assert again.of(replace(SPEC, seed=4)) is None
    again.add(replace(SPEC, seed=4), result(4, "failure"))
    assert path.read_bytes() == whole


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    path.write_text(json.dumps({"seed": 3}) + "\n")
    with pytest.raises(ConfigError, match=r"line 1: expected a trial written by this command"):
        ResultStore(path)


@pytest.mark.parametrize("content", [b'{"precious": 1}', b"precious", b"\xff\xfe\n", b"\xff"])
def test_a_file_that_is_not_ours_stays_as_it_is(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "notes.txt"
    path.write_bytes(content)
    with pytest.raises(ConfigError, match="expected a trial written by this command"):
        ResultStore(path)
    assert path.read_bytes() == content


def test_a_line_torn_anywhere_is_ours(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    whole = path.read_bytes()
    for length in (1, 20, 60, len(whole) - 1):
        path.write_bytes(whole + whole[:length])
        kept = ResultStore(path)
        assert kept.of(SPEC) == result(3)
        kept.add(SPEC, result(3))
        assert path.read_bytes() == 2 * whole


def test_a_line_that_another_process_is_writing_is_left_to_it(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    whole = path.read_bytes()
    with path.open("ab", buffering=0) as other:
        other.write(whole[:60])
        assert ResultStore(path).of(SPEC) == result(3)
        other.write(whole[60:])
    assert path.read_bytes() == 2 * whole


def test_where_nothing_can_be_kept_is_told(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="--out: cannot use"):
        ResultStore(tmp_path)
    kept = ResultStore(tmp_path / "trials.jsonl")
    (tmp_path / "trials.jsonl").mkdir()
    with pytest.raises(TrillError, match="give the same command again"):
        kept.add(SPEC, result(3))


@pytest.mark.parametrize("wrong", [["--pace", "brisk"], ["--physics-steps", "0"]])
def test_wrong_options_begin_no_worker(wrong: list[str]) -> None:
    with pytest.raises(SystemExit) as stop:
        main(["run", "door/unlock", "--seeds", "0", *wrong])
    assert stop.value.code == 2


def test_trouble_is_no_wrong_option(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def lost(*_: object) -> None:
        raise TrillError("the worker was lost")

    monkeypatch.setattr("lab.studies.tasks.command.run_campaign", lost)
    assert main(["run", "door/unlock", "--seeds", "0"]) == 1
    assert "the worker was lost" in capsys.readouterr().err
    assert main(["run", "door/unlock", "--out", str(tmp_path)]) == 2


def test_a_campaign_runs_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    told: list[TrialResult] = []
    trials = [replace(SPEC, seed=0), SPEC]
    first, second = run_campaign(trials, ResultStore(path), 1, told.append)
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
    assert "needs the package mujoco: pip install 'trill[study]'" in done.stderr
    assert "Traceback" not in done.stderr


def test_trials_with_other_packages_do_not_count(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "trials.jsonl"
    ResultStore(path).add(SPEC, result(3))
    monkeypatch.setattr(campaign, "package_versions", lambda _: {"mujoco": "99.0"})
    kept = ResultStore(path)
    assert (kept.of(SPEC), kept.strange) == (None, 1)
