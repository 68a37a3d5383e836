"""Fault plans: set-up, fault, expected recovery, and limits that judge the measured numbers."""

from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, ClassVar

from pydantic import BaseModel, ConfigDict

from common.errors import TrillError

Row = Mapping[str, str | int | float]
"""One line of a table of results: column heading to value."""
Progress = Callable[[str], None]
"""Reports what an experiment is doing."""


class FaultError(TrillError):
    """A fault experiment cannot be run."""


@dataclass(frozen=True)
class Verdict:
    """Result of a promise: the worst measured value against the limit."""

    promise: str
    limit: float
    measured: float
    kept: bool


@dataclass(frozen=True)
class Promise:
    """Upper limit of a column.

    Attributes:
        text: the promise in words.
        column: heading of the judged column.
        at_most: largest value that keeps the promise.
        where: judge only the rows that have these values.
    """

    text: str
    column: str
    at_most: float
    where: Mapping[str, str] = field(default_factory=dict)

    def judge(self, rows: Sequence[Row]) -> Verdict:
        """Compare the largest value with the limit; a promise that was not measured is broken."""
        judged = [row for row in rows if self.where.items() <= row.items()]
        worst = max((float(row[self.column]) for row in judged), default=float("nan"))
        return Verdict(self.text, self.at_most, worst, worst <= self.at_most)


class FaultPlan(BaseModel, ABC):
    """A fault experiment; the fields of the model are its options.

    Attributes:
        name: name on the command line.
        setup: what runs.
        fault: what is done to it.
        recovery: what the system is expected to do then.
        promises: limits that the measured numbers must keep.
        quick: values of the options for a short run.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    name: ClassVar[str]
    setup: ClassVar[str]
    fault: ClassVar[str]
    recovery: ClassVar[str]
    promises: ClassVar[tuple[Promise, ...]]
    quick: ClassVar[Mapping[str, Any]]

    @abstractmethod
    def measure(self, progress: Progress) -> Iterable[Row]:
        """Run the experiment and return the rows of its table.

        Raises:
            FaultError: it cannot be run.
        """
