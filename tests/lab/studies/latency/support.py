"""Invented trials and answers, for tests of everything but the trial itself."""

from collections.abc import Container
from datetime import UTC, datetime
from itertools import count
from typing import Any

from lab.studies.latency.conditions import Condition, standard
from lab.studies.latency.plan import Plan, TrialKey
from lab.studies.latency.record import LinkLatency, StudyTrial
from lab.studies.latency.tlx import SCALES, AnswerSheet, Scale
from lab.trials.provenance import CodeVersion
from tests.lab.trials.fake_executor import FakeExecutor

UNLOCK, HAMMER = "door/unlock", "bench/hammer"
CONDITIONS = standard("command")
CODE = CodeVersion(source="abc", versions={"mujoco": "3"})
PLAN = Plan(conditions=CONDITIONS, code=CODE)
NAMES = [condition.name for condition in CONDITIONS]


def trial(
    condition: str = "interpolation",
    seed: int = 0,
    time: float = 8.0,
    verdict: str = "success",
    **more: Any,
) -> StudyTrial:
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
        "command": LinkLatency(asked_mean=0.25, asked_p99=0.25, mean=0.255, p99=0.26, used=100),
    }
    return StudyTrial.model_validate(values | more)


def trials(times: dict[str, float], seeds: int = 6, task: str = UNLOCK) -> list[StudyTrial]:
    """Trials whose times are those of their condition, a little more with each seed."""
    return [
        trial(name, seed, time + 0.1 * seed, task=task)
        for name, time in times.items()
        for seed in range(seeds)
    ]


def fake_executor(fails_at: Container[int] = ()) -> FakeExecutor:
    """Return an executor that invents trials; it loses workers at the calls ``fails_at``."""
    calls = count(1)

    def make(key: TrialKey) -> StudyTrial:
        return trial(key.condition, key.seed, task=key.task)

    return FakeExecutor(make, loses=lambda _key: next(calls) in fails_at)


def plan_of(*conditions: Condition, **more: Any) -> Plan:
    return Plan.model_validate(PLAN.model_dump() | {"conditions": conditions} | more)


RATINGS: dict[Scale, int] = dict(zip(SCALES, (55, 20, 40, 10, 60, 25), strict=True))
WEIGHTS: dict[Scale, int] = dict(zip(SCALES, (5, 4, 3, 2, 1, 0), strict=True))


def sheet(condition: str = "interpolation", participant: str = "P01", **more: Any) -> AnswerSheet:
    values: dict[str, Any] = {
        "participant": participant,
        "task": UNLOCK,
        "condition": condition,
        "date": datetime(2026, 3, 1, 12, 0, tzinfo=UTC),
        "ratings": RATINGS,
    }
    return AnswerSheet.model_validate(values | more)
