"""NASA Task Load Index: answer sheets, their scores, and their summary.

A sheet rates six scales from 0 to 100 in steps of 5 (Hart & Staveland 1988); the raw score is their
mean. In the full procedure the person also says for each of the 15 pairs of scales which one
contributed more to the workload. A scale's weight is how often it was chosen, and the weighted
score is the mean with these weights.
"""

import re
from collections.abc import Iterable, Sequence
from itertools import combinations
from pathlib import Path
from statistics import fmean
from typing import Annotated, Literal, NamedTuple

from pydantic import (
    AfterValidator,
    AwareDatetime,
    Field,
    NonNegativeInt,
)

from lab.errors import LatencyStudyError
from lab.studies.latency.record import Record
from lab.trials.folder import locked_folder, read_model, write_model

Scale = Literal["mental", "physical", "temporal", "performance", "effort", "frustration"]
PSEUDONYM = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,39}$"
Pseudonym = Annotated[str, Field(pattern=PSEUDONYM)]
STEP = 5


class ScaleText(NamedTuple):
    """How a person is asked for a scale."""

    title: str
    question: str
    low: str = "Low"
    high: str = "High"


SCALES: dict[Scale, ScaleText] = {
    "mental": ScaleText("Mental demand", "How mentally demanding was the task?"),
    "physical": ScaleText("Physical demand", "How physically demanding was the task?"),
    "temporal": ScaleText("Temporal demand", "How hurried or rushed was the pace of the task?"),
    "performance": ScaleText(
        "Performance",
        "How successful were you in accomplishing what you were asked to do?",
        low="Good",
        high="Poor",
    ),
    "effort": ScaleText(
        "Effort", "How hard did you have to work to accomplish your level of performance?"
    ),
    "frustration": ScaleText(
        "Frustration", "How insecure, discouraged, irritated, stressed and annoyed were you?"
    ),
}
"""The scales in the order of the sheet; a higher number is a higher load on each of them."""
PAIRS: tuple[tuple[Scale, Scale], ...] = tuple(combinations(SCALES, 2))


def _check_all_scales(values: dict[Scale, int]) -> dict[Scale, int]:
    if missing := [scale for scale in SCALES if scale not in values]:
        raise ValueError(f"expected all six scales; {', '.join(missing)} missing")
    return values


def _check_weights(weights: dict[Scale, int]) -> dict[Scale, int]:
    counts = sorted(_check_all_scales(weights).values())
    # Any k scales have k (k - 1) / 2 pairs among themselves, and each pair gives a choice to one.
    possible = all(sum(counts[:k]) >= k * (k - 1) // 2 for k in range(1, len(counts)))
    if sum(counts) != len(PAIRS) or not possible:
        raise ValueError(f"expected weights from {len(PAIRS)} choices between two scales")
    return weights


Rating = Annotated[int, Field(strict=True, ge=0, le=100, multiple_of=STEP)]
Ratings = Annotated[dict[Scale, Rating], AfterValidator(_check_all_scales)]
Weight = Annotated[int, Field(strict=True, ge=0)]
Weights = Annotated[dict[Scale, Weight], AfterValidator(_check_weights)]


class Answers(Record):
    """Answers of a person to the questions of a sheet.

    Attributes:
        ratings: ratings of the six scales.
        weights: how often each scale was chosen; None: the pairs were not asked.
        remarks: remarks of the person.
    """

    ratings: Ratings
    weights: Weights | None = None
    remarks: str = ""

    @property
    def raw_score(self) -> float:
        """Mean of the six ratings, 0 to 100."""
        return fmean(self.ratings.values())

    @property
    def weighted_score(self) -> float | None:
        """Weighted mean of the ratings, 0 to 100; None: there are no weights."""
        if self.weights is None:
            return None
        return sum(self.weights[s] * self.ratings[s] for s in SCALES) / len(PAIRS)


class AnswerSheet(Answers):
    """Answers of one person after one condition of one task.

    Attributes:
        participant: pseudonym of the person; never a name.
        task: name of the task.
        condition: name of the condition in the study.
        seeds: seeds of the trials that the answers are about.
        date: when the sheet was filled in, with time zone.
    """

    version: Literal[1] = 1
    participant: Pseudonym
    task: str = Field(min_length=1, max_length=80)
    condition: str = Field(min_length=1, max_length=40)
    seeds: tuple[NonNegativeInt, ...] = ()
    date: AwareDatetime


def write_sheet(folder: Path, sheet: AnswerSheet) -> Path:
    """Write a sheet to a file of its own, which is never replaced; returns the file.

    Raises:
        LatencyStudyError: the file exists already, or cannot be written.
    """
    stamp = sheet.date.strftime("%Y%m%d-%H%M%S")
    words = (sheet.participant, sheet.task, sheet.condition, stamp)
    name = "_".join(re.sub(r"[^A-Za-z0-9.-]+", "-", word) for word in words)
    path = folder / f"{name}.json"
    with locked_folder(folder, LatencyStudyError):
        if path.exists():
            raise LatencyStudyError(f"{path} is there already; a sheet is never replaced")
        write_model(path, sheet, LatencyStudyError)
    return path


def read_sheets(folder: Path) -> list[AnswerSheet]:
    """Read all sheets of a study, sorted by participant and date.

    Raises:
        LatencyStudyError: a file is no answer sheet.
    """
    paths = sorted(folder.glob("*.json"))
    sheets = [read_model(path, AnswerSheet, LatencyStudyError) for path in paths]
    return sorted(filter(None, sheets), key=lambda sheet: (sheet.participant, sheet.date))


class Workload(Record):
    """Summary of the sheets of one condition of one task; means are over sheets.

    Attributes:
        task: name of the task.
        condition: name of the condition.
        sheets: number of sheets.
        participants: number of persons.
        scales: mean rating of each scale.
        raw: mean raw score.
        weighted: mean weighted score of the sheets that have weights; None: no sheet has.
        weighted_sheets: number of sheets that have weights.
    """

    task: str
    condition: str
    sheets: int
    participants: int
    scales: dict[Scale, float]
    raw: float
    weighted: float | None
    weighted_sheets: int


def summarise_sheets(
    sheets: Iterable[AnswerSheet], tasks: Sequence[str], conditions: Sequence[str]
) -> list[Workload]:
    """Summarise every condition of every task that has sheets, in the given order."""
    cells: dict[tuple[str, str], list[AnswerSheet]] = {}
    for sheet in sheets:
        cells.setdefault((sheet.task, sheet.condition), []).append(sheet)
    found = []
    for task, condition in ((t, c) for t in tasks for c in conditions if (t, c) in cells):
        mine = cells[task, condition]
        weighted = [sheet.weighted_score for sheet in mine if sheet.weighted_score is not None]
        found.append(
            Workload(
                task=task,
                condition=condition,
                sheets=len(mine),
                participants=len({sheet.participant for sheet in mine}),
                scales={scale: fmean(sheet.ratings[scale] for sheet in mine) for scale in SCALES},
                raw=fmean(sheet.raw_score for sheet in mine),
                weighted=fmean(weighted) if weighted else None,
                weighted_sheets=len(weighted),
            )
        )
    return found
