import json
import random
import re
import shlex
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from common.errors import ConfigError
from lab.cli.main import main
from lab.cli.study_human import ask
from lab.errors import LatencyStudyError
from lab.studies.latency.store import StudyStore
from lab.studies.latency.tlx import (
    PAIRS,
    SCALES,
    AnswerSheet,
    read_sheets,
    summarise_sheets,
    write_sheet,
)
from tests.disk import fill
from tests.lab.studies.latency.support import NAMES, PLAN, RATINGS, UNLOCK, WEIGHTS, sheet


def test_both_scores_by_hand() -> None:
    # (55 + 20 + 40 + 10 + 60 + 25) / 6
    assert sheet().raw_score == pytest.approx(35.0)
    assert sheet().weighted_score is None
    full = sheet(weights=WEIGHTS)
    # (5*55 + 4*20 + 3*40 + 2*10 + 1*60 + 0*25) / 15 = 555 / 15
    assert full.weighted_score == pytest.approx(37.0)


def test_six_scales_make_fifteen_pairs() -> None:
    assert len(SCALES) == 6
    assert len(PAIRS) == 15
    assert (SCALES["performance"].low, SCALES["performance"].high) == ("Good", "Poor")
    assert all((t.low, t.high) == ("Low", "High") for s, t in SCALES.items() if s != "performance")


@pytest.mark.parametrize(
    ("ratings", "says"),
    [
        ({"mental": 57}, "multiple of 5"),
        ({"mental": 105}, "less than or equal to 100"),
        ({"mental": -5}, "greater than or equal to 0"),
        ({"mental": 55.0}, "integer"),
        ({"mental": True}, "integer"),
        ({"mental": "55"}, "integer"),
        ({"mental": None}, "integer"),
        ({"calm": 5}, "calm"),
    ],
)
def test_wrong_ratings_are_refused(ratings: dict[str, object], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        sheet(ratings=RATINGS | ratings)


@pytest.mark.parametrize("scale", SCALES)
def test_no_scale_may_be_left_out(scale: str) -> None:
    with pytest.raises(ValidationError, match=f"{scale} missing"):
        sheet(ratings={name: value for name, value in RATINGS.items() if name != scale})


@pytest.mark.parametrize(
    "weights",
    [
        {"effort": 2},
        {"effort": 2, "frustration": -1},
        # Fifteen choices, but one of two scales is chosen where they meet.
        {"mental": 5, "physical": 5, "temporal": 5, "performance": 0, "effort": 0},
        {"mental": 6, "temporal": 2},
    ],
)
def test_weights_that_fifteen_choices_cannot_give_are_refused(weights: dict[str, int]) -> None:
    with pytest.raises(ValidationError, match="weights"):
        sheet(weights=WEIGHTS | weights)


@pytest.mark.parametrize(
    "wrong",
    [{"participant": "Jane Doe"}, {"participant": ""}, {"mood": 3}, {"date": "2026-03-01T12:00"}],
)
def test_other_keys_names_and_dates_without_a_zone_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        sheet(**wrong)


def test_a_sheet_is_kept_as_it_was_and_never_replaced(tmp_path: Path) -> None:
    kept = sheet(weights=WEIGHTS, remarks="zäh", seeds=[3, 4])
    path = write_sheet(tmp_path, kept)
    assert read_sheets(tmp_path) == [kept]
    assert AnswerSheet.model_validate_json(path.read_bytes()) == kept
    assert "zäh" in path.read_text(encoding="utf-8")
    with pytest.raises(LatencyStudyError, match="never replaced"):
        write_sheet(tmp_path, kept)
    (tmp_path / "other.json").write_text("{}")
    with pytest.raises(LatencyStudyError, match=r"other\.json"):
        read_sheets(tmp_path)


def test_half_a_sheet_is_not_left(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fill(monkeypatch)
    with pytest.raises(LatencyStudyError, match="No space left"):
        write_sheet(tmp_path, sheet())
    monkeypatch.undo()
    assert read_sheets(tmp_path) == []
    assert read_sheets(write_sheet(tmp_path, sheet()).parent) == [sheet()]


def test_workload_of_a_condition() -> None:
    easy = sheet(participant="P02", ratings=dict.fromkeys(SCALES, 5))
    (part,) = summarise_sheets([sheet(weights=WEIGHTS), easy], [UNLOCK], NAMES)
    assert (part.sheets, part.participants, part.weighted_sheets) == (2, 2, 1)
    assert part.raw == pytest.approx(20.0)
    assert part.weighted == pytest.approx(37.0)
    assert part.scales["effort"] == pytest.approx(32.5)


def typed(*lines: str, prompts: list[str] | None = None) -> Callable[[str], str]:
    left = list(lines)

    def read(prompt: str) -> str:
        if prompts is not None:
            prompts.append(prompt)
        if not left:
            raise EOFError
        return left.pop(0)

    return read


def test_a_wrong_answer_is_asked_for_again(capsys: pytest.CaptureFixture[str]) -> None:
    ratings = ["", "57", "fifty", "55", "20", "40", "105", "10", "60", "25"]
    prompts: list[str] = []
    read = typed(*ratings, "3", *["1"] * 15, "slow ", prompts=prompts)
    answers = ask(read, random.Random(1), pairs=True)
    assert answers.ratings == RATINGS
    assert answers.remarks == "slow"
    assert answers.weights is not None
    # Every pair was shown once; its first scale was chosen.
    shown = [re.split("   [12] ", prompt.rstrip(": "))[1:] for prompt in prompts[11:-1]]
    assert {frozenset(pair) for pair in shown} == {
        frozenset(SCALES[scale].title for scale in pair) for pair in PAIRS
    }
    assert answers.weights == {
        scale: [first for first, _ in shown].count(text.title) for scale, text in SCALES.items()
    }
    complaints = [line for line in capsys.readouterr().out.splitlines() if "expected" in line]
    assert [text.rpartition("got ")[2] for text in complaints] == [
        "''", "'57'", "'fifty'", "'105'", "'3'",
    ]  # fmt: skip


def test_pairs_come_in_random_order_and_either_way_round() -> None:
    orders = []
    for seed in (1, 2):
        prompts: list[str] = []
        read = typed(*["50"] * 6, *["1"] * 15, "", prompts=prompts)
        ask(read, random.Random(seed), pairs=True)
        orders.append(prompts[6:-1])
    assert orders[0] != orders[1]
    titles = [tuple(SCALES[scale].title for scale in pair) for pair in PAIRS]
    as_listed = sum(f"1 {a}   2 {b}:" in prompt for a, b in titles for prompt in orders[0])
    assert 0 < as_listed < 15


def test_an_end_before_the_last_answer_leaves_nothing() -> None:
    with pytest.raises(ConfigError, match="nothing was written"):
        ask(typed("55", "20"), random.Random(1), pairs=False)
    assert ask(typed(*["55"] * 6, ""), random.Random(1), pairs=False).weights is None


def test_the_command_takes_answers_from_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with StudyStore(tmp_path / "study").writing(PLAN):
        pass
    answers = tmp_path / "p01.json"
    words = ["study", "tlx", "--participant", "P01", "--out", str(tmp_path / "study")]
    words += ["--answers", str(answers), "--condition", "raw", "--task"]

    answers.write_text(json.dumps({"ratings": RATINGS | {"effort": 61}}))
    assert main([*words, UNLOCK]) == 2
    assert "ratings.effort" in capsys.readouterr().err
    answers.write_text(json.dumps({"ratings": RATINGS, "condition": "latency-250"}))
    assert main([*words, UNLOCK]) == 2
    assert "condition" in capsys.readouterr().err
    assert main([*words, "door/walk"]) == 2
    assert "not in the study" in capsys.readouterr().err
    assert not (tmp_path / "study" / "tlx").exists()

    answers.write_text(json.dumps({"ratings": RATINGS, "weights": WEIGHTS}))
    assert main([*words, UNLOCK, "--seeds", "3", "4", "--remarks", "slow"]) == 0
    assert "raw score 35.0, weighted 37.0" in capsys.readouterr().out
    (kept,) = read_sheets(tmp_path / "study" / "tlx")
    assert (kept.participant, kept.task, kept.condition) == ("P01", UNLOCK, "raw")
    assert (kept.seeds, kept.remarks) == ((3, 4), "slow")


def test_the_advice_for_a_fresh_folder_works_with_persons_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    root = tmp_path / "a study"
    answers = tmp_path / "p01.json"
    answers.write_text(json.dumps({"ratings": RATINGS}))
    words = ["study", "tlx", "--participant", "P01", "--out", str(root), "--task", UNLOCK]
    words += ["--answers", str(answers), "--condition", "raw"]
    assert main(words) == 1
    said = capsys.readouterr().err
    begin = re.search(r"with: (trill study latency .*)$", said, re.MULTILINE)
    assert begin is not None
    # Without it the synthetic operator would run its whole study first.
    assert "--episodes 0" in begin[1]
    assert main(shlex.split(begin[1])[1:]) == 0
    assert not list(root.glob("trials*"))
    assert main(words) == 0
    assert main(["study", "latency", "--report", str(root)]) == 0
    assert (root / "workload.csv").is_file()
