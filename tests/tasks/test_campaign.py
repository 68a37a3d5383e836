"""Many trials: what is kept is not run again, whatever happened in between."""

import json
from dataclasses import replace
from pathlib import Path

import pytest

from common.errors import ConfigError
from studies.tasks import campaign
from studies.tasks.campaign import Kept, run_campaign
from studies.tasks.stack import TrialResult, TrialSpec

SPEC = TrialSpec("door/unlock", 3, physics_steps=5)


def result(seed: int, verdict: str = "success") -> TrialResult:
    return TrialResult(
        *("door/unlock", seed, verdict, 7.5, "it was", "", "done", ("lever pressed",), 9.0, 4.5),
        links={"command": "250ms"},
    )


def test_a_kept_trial_is_not_run_again(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "trials.jsonl"
    Kept(path).add(SPEC, result(3))
    told: list[TrialResult] = []
    # With the trial kept no worker is begun.
    assert run_campaign([SPEC], Kept(path), 2, told.append) == [result(3)]
    assert told == []


def test_a_trial_counts_only_with_the_same_settings(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    Kept(path).add(SPEC, result(3))
    kept = Kept(path)
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
    Kept(path).add(SPEC, result(3))
    monkeypatch.setattr(campaign, "digest", lambda _root: "another")
    kept = Kept(path)
    assert (kept.of(SPEC), kept.strange) == (None, 1)


def test_a_torn_line_is_dropped_and_the_next_begins_on_its_own(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    kept = Kept(path)
    kept.add(SPEC, result(3))
    kept.add(replace(SPEC, seed=4), result(4, "failure"))
    whole = path.read_bytes()
    path.write_bytes(whole[:-30])
    again = Kept(path)
    assert again.of(SPEC) == result(3)
    assert again.of(replace(SPEC, seed=4)) is None
    again.add(replace(SPEC, seed=4), result(4, "failure"))
    assert path.read_bytes() == whole


def test_a_file_of_something_else_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    path.write_text(json.dumps({"seed": 3}) + "\n")
    with pytest.raises(ConfigError, match=r"line 1: expected a trial written by this command"):
        Kept(path)


def test_a_campaign_runs_what_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    Kept(path).add(SPEC, result(3))
    told: list[TrialResult] = []
    trials = [replace(SPEC, seed=0), SPEC]
    first, second = run_campaign(trials, Kept(path), 1, told.append)
    assert (first.seed, first.verdict, second) == (0, "success", result(3))
    assert told == [first]
    assert len(path.read_text().splitlines()) == 2
