"""Invented trials and answers, for tests of everything but the trial itself."""

from collections.abc import Callable, Container
from concurrent.futures import Future
from datetime import UTC, datetime
from typing import Any

from lab.studies.latency.conditions import Condition, standard
from lab.studies.latency.plan import Plan, TrialKey
from lab.studies.latency.row import LinkTake, TrialRow
from lab.studies.latency.tlx import PAIRS, AnswerSheet, PairChoice, Ratings

UNLOCK, HAMMER = "door/unlock", "bench/hammer"
CONDITIONS = standard("command")
PLAN = Plan(conditions=CONDITIONS, versions={"mujoco": "3"})
NAMES = [condition.name for condition in CONDITIONS]


def row(
    condition: str = "interpolation",
    seed: int = 0,
    time: float = 8.0,
    verdict: str = "success",
    **more: Any,
) -> TrialRow:
    """A trial; what is no success was not completed unless ``reached`` says so."""
    values: dict[str, Any] = {
        "task": UNLOCK,
        "condition": condition,
        "seed": seed,
        "time": time,
        "verdict": verdict,
        "reached": verdict == "success",
        "limit": 20.0,
        "reason": f"{verdict} it was",
        "wall": 4.0,
        "command": LinkTake(asked_mean=0.25, asked_p99=0.25, mean=0.255, p99=0.26, used=100),
    }
    return TrialRow.model_validate(values | more)


def rows(times: dict[str, float], seeds: int = 6, task: str = UNLOCK) -> list[TrialRow]:
    """Trials whose times are those of their condition, a little more with each seed."""
    return [
        row(name, seed, time + 0.1 * seed, task=task)
        for name, time in times.items()
        for seed in range(seeds)
    ]


class FakeExecutor:
    """Does each trial at once, with an invented outcome; is lost at those numbered ``fails_at``."""

    lost: tuple[type[Exception], ...] = (ConnectionError,)

    def __init__(self, fails_at: Container[int] = ()) -> None:
        self.size = 2
        self.given: list[TrialKey] = []
        self.ended = False
        self._fails_at = fails_at

    def submit(self, work: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        (key,) = arguments
        self.given.append(key)
        future: Future[Any] = Future()
        if len(self.given) in self._fails_at:
            future.set_exception(ConnectionError("gone"))
        else:
            future.set_result(row(key.condition, key.seed, task=key.task))
        return future

    def watch(self) -> list[str]:
        return []

    def end(self) -> None:
        self.ended = True


def plan_of(*conditions: Condition, **more: Any) -> Plan:
    return Plan.model_validate(PLAN.model_dump() | {"conditions": conditions} | more)


RATINGS = Ratings(mental=55, physical=20, temporal=40, performance=10, effort=60, frustration=25)


def choices() -> tuple[PairChoice, ...]:
    """Always the one that comes first on the sheet: weights 5, 4, 3, 2, 1, 0."""
    return tuple(PairChoice(pair=pair, chosen=pair[0]) for pair in PAIRS)


def sheet(condition: str = "interpolation", participant: str = "P01", **more: Any) -> AnswerSheet:
    values: dict[str, Any] = {
        "participant": participant,
        "task": UNLOCK,
        "condition": condition,
        "date": datetime(2026, 3, 1, 12, 0, tzinfo=UTC),
        "ratings": RATINGS,
    }
    return AnswerSheet.model_validate(values | more)
