"""NASA Task Load Index: one answer sheet, its scores, and the sheets of a study.

Six scales of 21 steps, 0 to 100 by 5 (Hart & Staveland 1988). The raw score is their mean. In the
full procedure the person also says of each of the 15 pairs of scales which contributed more to the
workload; a scale's weight is how often it was chosen, 0 to 5, and the weighted score is the mean
with these weights, which sum to 15.
"""

import json
import random
import re
from collections import Counter
from collections.abc import Iterable, Sequence
from datetime import datetime
from itertools import combinations
from pathlib import Path
from statistics import fmean
from typing import Annotated, Literal, Self

from pydantic import (
    AwareDatetime,
    BaseModel,
    ConfigDict,
    Field,
    Strict,
    ValidationError,
    field_validator,
    model_validator,
)

from common.errors import explain
from common.files import write_whole
from lab.errors import LatencyStudyError

Scale = Literal["mental", "physical", "temporal", "performance", "effort", "frustration"]
PSEUDONYM = r"^[A-Za-z0-9][A-Za-z0-9_-]*$"
STEP = 5


class ScaleText(BaseModel):
    """How a scale is put to a person."""

    model_config = ConfigDict(frozen=True)

    title: str
    question: str
    low: str = "Low"
    high: str = "High"


SCALES: dict[Scale, ScaleText] = {
    "mental": ScaleText(title="Mental demand", question="How mentally demanding was the task?"),
    "physical": ScaleText(
        title="Physical demand", question="How physically demanding was the task?"
    ),
    "temporal": ScaleText(
        title="Temporal demand", question="How hurried or rushed was the pace of the task?"
    ),
    "performance": ScaleText(
        title="Performance",
        question="How successful were you in accomplishing what you were asked to do?",
        low="Good",
        high="Poor",
    ),
    "effort": ScaleText(
        title="Effort",
        question="How hard did you have to work to accomplish your level of performance?",
    ),
    "frustration": ScaleText(
        title="Frustration",
        question="How insecure, discouraged, irritated, stressed and annoyed were you?",
    ),
}
"""In the order of the sheet; a higher number is a higher load on every scale."""
PAIRS: tuple[tuple[Scale, Scale], ...] = tuple(combinations(SCALES, 2))


def is_pseudonym(text: str) -> bool:
    """Whether a participant may be called so."""
    return len(text) <= 40 and re.fullmatch(PSEUDONYM, text) is not None


def _on_scale(value: int) -> int:
    if not 0 <= value <= 100 or value % STEP:
        raise ValueError(f"expected 0 to 100 in steps of {STEP}, got {value}")
    return value


class _Record(BaseModel):
    model_config = ConfigDict(frozen=True, extra="forbid")


Rating = Annotated[int, Strict()]


class Ratings(_Record):
    """The six scales; none has a value beforehand."""

    mental: Rating
    physical: Rating
    temporal: Rating
    performance: Rating = Field(description="0 is good, 100 poor")
    effort: Rating
    frustration: Rating

    @field_validator("*")
    @classmethod
    def _steps(cls, value: int) -> int:
        return _on_scale(value)

    def of(self, scale: Scale) -> int:
        """One of them."""
        value: int = getattr(self, scale)
        return value


class PairChoice(_Record):
    """Which of two scales contributed more; ``pair`` as they were shown, first and second."""

    pair: tuple[Scale, Scale]
    chosen: Scale

    @model_validator(mode="after")
    def _one_of_them(self) -> Self:
        if self.pair[0] == self.pair[1] or self.chosen not in self.pair:
            raise ValueError(f"expected one of two scales; got {self.chosen} of {list(self.pair)}")
        return self


class AnswerSheet(_Record):
    """What one person answered after one condition of one task.

    Attributes:
        participant: pseudonym; never a name.
        task: for instance ``door/unlock``.
        condition: its name in the study.
        seeds: of the trials the answers are about.
        date: when it was answered, with its time zone.
        ratings: the six scales.
        choices: all 15 pairs in the order in which they were shown; empty: not asked.
        remarks: of the person.
    """

    version: Literal[1] = 1
    participant: str = Field(pattern=PSEUDONYM, max_length=40)
    task: str = Field(min_length=1, max_length=80)
    condition: str = Field(min_length=1, max_length=40)
    seeds: tuple[Annotated[int, Field(ge=0)], ...] = ()
    date: AwareDatetime
    ratings: Ratings
    choices: tuple[PairChoice, ...] = ()
    remarks: str = Field(default="", max_length=4000)

    @model_validator(mode="after")
    def _every_pair_once(self) -> Self:
        if not self.choices:
            return self
        shown = Counter(frozenset(choice.pair) for choice in self.choices)
        wrong = [pair for pair in PAIRS if shown[frozenset(pair)] != 1]
        if wrong:
            told = ", ".join(f"{a}-{b} {shown[frozenset((a, b))]} times" for a, b in wrong)
            raise ValueError(f"choices: expected each of the 15 pairs once; got {told}")
        return self

    @property
    def raw_score(self) -> float:
        """Mean of the six scales, 0 to 100."""
        return fmean(self.ratings.of(scale) for scale in SCALES)

    @property
    def weights(self) -> dict[Scale, int] | None:
        """How often each scale was chosen, 0 to 5; None: the pairs were not asked."""
        if not self.choices:
            return None
        count = Counter(choice.chosen for choice in self.choices)
        return {scale: count[scale] for scale in SCALES}

    @property
    def weighted_score(self) -> float | None:
        """Mean of the scales by weight, 0 to 100; None: the pairs were not asked."""
        weights = self.weights
        if weights is None:
            return None
        return sum(weights[s] * self.ratings.of(s) for s in SCALES) / len(PAIRS)


def shuffled_pairs(rng: random.Random) -> list[tuple[Scale, Scale]]:
    """The 15 pairs in random order, each way round at random."""
    pairs = [pair if rng.random() < 0.5 else (pair[1], pair[0]) for pair in PAIRS]
    rng.shuffle(pairs)
    return pairs


def write_sheet(folder: Path, sheet: AnswerSheet) -> Path:
    """Keep a sheet in a file of its own, never over another.

    Returns:
        the file.

    Raises:
        LatencyStudyError: it is there already, or cannot be written.
    """
    stamp = sheet.date.strftime("%Y%m%d-%H%M%S")
    words = (sheet.participant, sheet.task, sheet.condition, stamp)
    name = "_".join(re.sub(r"[^A-Za-z0-9.-]+", "-", word) for word in words)
    path = folder / f"{name}.json"
    text = json.dumps(sheet.model_dump(mode="json"), indent=1, ensure_ascii=False) + "\n"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if path.exists():
            raise LatencyStudyError(f"{path} is there already; a sheet is never replaced")
        # Half a sheet would stop every report from here on.
        write_whole(path, text.encode())
    except OSError as error:
        raise LatencyStudyError(f"cannot write {path}: {error.strerror}") from error
    return path


def read_sheets(folder: Path) -> list[AnswerSheet]:
    """Every sheet of a study, by participant and date.

    Raises:
        LatencyStudyError: a file is no answer sheet.
    """
    sheets = []
    for path in sorted(folder.glob("*.json")):
        try:
            sheets.append(AnswerSheet.model_validate_json(path.read_bytes()))
        except ValidationError as error:
            raise LatencyStudyError(f"{path} is no answer sheet: {explain(error)}") from error
    return sorted(sheets, key=lambda sheet: (sheet.participant, sheet.date))


class Workload(_Record):
    """The sheets of one condition of one task, summed up; all means over sheets.

    Attributes:
        task: its name.
        condition: its name.
        sheets: how many.
        participants: by how many.
        scales: mean of each.
        raw: mean raw score.
        weighted: mean weighted score of those sheets that have one; None: none has.
        weighted_sheets: how many of them.
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
    """Sum up every condition of every task that has sheets, in the order given."""
    by_cell: dict[tuple[str, str], list[AnswerSheet]] = {}
    for sheet in sheets:
        by_cell.setdefault((sheet.task, sheet.condition), []).append(sheet)
    return [
        _workload(by_cell[task, condition])
        for task in tasks
        for condition in conditions
        if (task, condition) in by_cell
    ]


def _workload(sheets: Sequence[AnswerSheet]) -> Workload:
    weighted = [score for sheet in sheets if (score := sheet.weighted_score) is not None]
    return Workload(
        task=sheets[0].task,
        condition=sheets[0].condition,
        sheets=len(sheets),
        participants=len({sheet.participant for sheet in sheets}),
        scales={s: fmean(sheet.ratings.of(s) for sheet in sheets) for s in SCALES},
        raw=fmean(sheet.raw_score for sheet in sheets),
        weighted=fmean(weighted) if weighted else None,
        weighted_sheets=len(weighted),
    )


def now() -> datetime:
    """The date for a sheet, with the local time zone."""
    return datetime.now().astimezone().replace(microsecond=0)
