import json
import random
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from pydantic import ValidationError

from common.errors import ConfigError
from lab.cli.main import main
from lab.cli.study_human import ask
from lab.errors import LatencyStudyError
from lab.studies.latency.store import Store
from lab.studies.latency.tlx import (
    PAIRS,
    SCALES,
    AnswerSheet,
    read_sheets,
    shuffled_pairs,
    summarise_sheets,
    write_sheet,
)
from tests.disk import fill
from tests.lab.studies.latency.support import NAMES, PLAN, RATINGS, UNLOCK, choices, sheet


def test_both_scores_by_hand() -> None:
    # (55 + 20 + 40 + 10 + 60 + 25) / 6
    assert sheet().raw_score == pytest.approx(35.0)
    assert sheet().weighted_score is None
    full = sheet(choices=choices())
    assert full.weights == {
        "mental": 5, "physical": 4, "temporal": 3, "performance": 2, "effort": 1, "frustration": 0,
    }  # fmt: skip
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
        ({"mental": 57}, "steps of 5, got 57"),
        ({"mental": 105}, "got 105"),
        ({"mental": -5}, "got -5"),
        ({"mental": 55.0}, "integer"),
        ({"mental": True}, "integer"),
        ({"mental": "55"}, "integer"),
        ({"mental": None}, "integer"),
        ({"calm": 5}, "Extra inputs"),
    ],
)
def test_wrong_ratings_are_refused(ratings: dict[str, object], says: str) -> None:
    with pytest.raises(ValidationError, match=says):
        sheet(ratings=RATINGS.model_dump() | ratings)


@pytest.mark.parametrize("scale", SCALES)
def test_no_scale_may_be_left_out(scale: str) -> None:
    with pytest.raises(ValidationError, match="Field required"):
        sheet(ratings=RATINGS.model_dump(exclude={scale}))


def test_every_pair_must_be_there_once() -> None:
    with pytest.raises(ValidationError, match="effort-frustration 0 times"):
        sheet(choices=choices()[:-1])
    twice = (*choices()[:-1], choices()[0])
    with pytest.raises(ValidationError, match="mental-physical 2 times"):
        sheet(choices=twice)
    with pytest.raises(ValidationError, match="effort of"):
        sheet(choices=[{"pair": ["mental", "physical"], "chosen": "effort"}])


@pytest.mark.parametrize(
    "wrong",
    [{"participant": "Jane Doe"}, {"participant": ""}, {"mood": 3}, {"date": "2026-03-01T12:00"}],
)
def test_other_keys_names_and_dates_without_a_zone_are_refused(wrong: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        sheet(**wrong)


def test_pairs_come_in_random_order_and_either_way_round() -> None:
    one, other = (shuffled_pairs(random.Random(seed)) for seed in (1, 2))
    assert one != other
    assert {frozenset(pair) for pair in one} == {frozenset(pair) for pair in PAIRS}
    assert any(pair not in PAIRS for pair in one)
    assert any(pair in PAIRS for pair in one)


def test_a_sheet_is_kept_as_it_was_and_never_replaced(tmp_path: Path) -> None:
    backwards = tuple(reversed(choices()))
    kept = sheet(choices=backwards, remarks="zäh", seeds=[3, 4])
    path = write_sheet(tmp_path, kept)
    assert read_sheets(tmp_path) == [kept]
    assert AnswerSheet.model_validate_json(path.read_bytes()).choices == backwards
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
    (part,) = summarise_sheets([sheet(choices=choices()), easy], [UNLOCK], NAMES)
    assert (part.sheets, part.participants, part.weighted_sheets) == (2, 2, 1)
    assert part.raw == pytest.approx(20.0)
    assert part.weighted == pytest.approx(37.0)
    assert part.scales["effort"] == pytest.approx(32.5)


def typed(*lines: str) -> Callable[[str], str]:
    left = list(lines)

    def read(_prompt: str) -> str:
        if not left:
            raise EOFError
        return left.pop(0)

    return read


def test_asking_insists_on_answers_that_are_some() -> None:
    shown: list[str] = []
    read = typed("", "57", "fifty", "55", "20", "40", "105", "10", "60", "25", "3", *["1"] * 15)
    answers = ask(read, shown.append, random.Random(1), pairs=True)
    assert answers["ratings"] == RATINGS.model_dump()
    assert [choice["pair"] for choice in answers["choices"]] == shuffled_pairs(random.Random(1))
    assert all(choice["chosen"] == choice["pair"][0] for choice in answers["choices"])
    complaints = [line for line in shown if "expected" in line]
    assert [text.rpartition("got ")[2] for text in complaints] == [
        "''", "'57'", "'fifty'", "'105'", "'3'",
    ]  # fmt: skip


def test_an_end_before_the_last_answer_leaves_nothing() -> None:
    with pytest.raises(ConfigError, match="nothing written"):
        ask(typed("55", "20"), lambda _line: None, random.Random(1), pairs=False)


def test_the_command_takes_answers_from_a_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    with Store(tmp_path / "study").writing(PLAN):
        pass
    answers = tmp_path / "p01.json"
    words = ["study", "tlx", "--participant", "P01", "--out", str(tmp_path / "study")]
    words += ["--answers", str(answers), "--condition", "raw", "--task"]

    answers.write_text(json.dumps({"ratings": RATINGS.model_dump() | {"effort": 61}}))
    assert main([*words, UNLOCK]) == 2
    assert "ratings.effort: expected 0 to 100 in steps of 5, got 61" in capsys.readouterr().err
    answers.write_text(json.dumps({"ratings": RATINGS.model_dump(), "condition": "latency-250"}))
    assert main([*words, UNLOCK]) == 2
    assert "which?" in capsys.readouterr().err
    assert main([*words, "door/walk"]) == 2
    assert "not in the study" in capsys.readouterr().err
    assert not (tmp_path / "study" / "tlx").exists()

    chosen = [choice.model_dump() for choice in choices()]
    answers.write_text(json.dumps({"ratings": RATINGS.model_dump(), "choices": chosen}))
    assert main([*words, UNLOCK]) == 0
    assert "raw score 35.0, weighted 37.0" in capsys.readouterr().out
    (kept,) = read_sheets(tmp_path / "study" / "tlx")
    assert (kept.participant, kept.task, kept.condition) == ("P01", UNLOCK, "raw")
