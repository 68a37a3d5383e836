"""The plan of a study: everything that decides its results except the number of episodes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

from pydantic import Field, model_validator

from common.errors import ConfigError
from lab.studies.latency.conditions import BASELINE, Condition
from lab.trials.operators.kinds import operator_code
from lab.trials.operators.specs import OperatorSpec, SyntheticSpec
from lab.trials.provenance import CodeVersion
from lab.trials.spec import TrialSettings, TrialSpec, settings_differences, validated
from services.sim.tasks import find_task

DEFAULT_TASKS = ("door/unlock", "bench/hammer")
"""The two manipulation tasks that the paper simulates."""


@dataclass(frozen=True, order=True)
class TrialKey:
    """Identifies one trial of the study.

    Trials are run in the order of their keys, so that a study which was cut off has the same seeds
    in every condition.
    """

    seed: int
    task: str
    condition: str

    def __str__(self) -> str:
        return f"{self.task} {self.condition} with seed {self.seed}"


class Plan(TrialSettings):
    """The study's tasks and conditions, and the settings that all trials share.

    Attributes:
        tasks: names of the tasks.
        conditions: the conditions that are compared, with the same seeds in each.
        first_seed: seed of the first trial of each condition; the next trial has the next seed.
        code: version of the code that runs the trials.
    """

    tasks: tuple[str, ...] = Field(default=DEFAULT_TASKS, min_length=1)
    conditions: tuple[Condition, ...] = Field(min_length=1)
    first_seed: int = Field(default=0, ge=0)
    code: CodeVersion

    @model_validator(mode="after")
    def _different(self) -> Self:
        names = [condition.name for condition in self.conditions]
        if len(set(names)) != len(names) or len(set(self.tasks)) != len(self.tasks):
            raise ValueError(
                f"expected each task and condition once, got {list(self.tasks)} and {names}"
            )
        return self

    @classmethod
    def checked(cls, values: dict[str, Any]) -> Self:
        """Return the plan with these values, to be run by this process's code.

        Raises:
            ConfigError: a value is wrong.
            TaskError: there is no such task.
        """
        code = study_code(values.get("operator", SyntheticSpec()))
        plan = validated(cls, {"code": code} | values)
        for task in plan.tasks:
            find_task(task)
        return plan

    @property
    def baseline(self) -> Condition:
        """The condition that the others are compared with.

        It is the paper's final set-up if it is among them; else the first condition with
        interpolation and without delay; else the first.
        """
        named = [c for c in self.conditions if c.name == BASELINE]
        plain = [c for c in self.conditions if not c.links and not c.raw_hands]
        return (named + plain + list(self.conditions))[0]

    def condition(self, name: str) -> Condition:
        """Return the condition with this name.

        Raises:
            ConfigError: there is none.
        """
        for condition in self.conditions:
            if condition.name == name:
                return condition
        known = ", ".join(condition.name for condition in self.conditions)
        raise ConfigError(f"no condition {name!r} in this study; expected one of {known}")

    def keys(self, episodes: int) -> Iterator[TrialKey]:
        """Return the keys of all trials, in the order in which they are run."""
        for seed in range(self.first_seed, self.first_seed + episodes):
            for task in self.tasks:
                for condition in self.conditions:
                    yield TrialKey(seed, task, condition.name)

    def spec(self, key: TrialKey) -> TrialSpec:
        """Return the trial of a key; its links are the condition's alone, not the task's own."""
        condition = self.condition(key.condition)
        return TrialSpec(
            task=key.task,
            seed=key.seed,
            links=condition.links,
            raw_hands=condition.raw_hands,
            **{name: getattr(self, name) for name in TrialSettings.model_fields},
        )

    def differences(self, other: "Plan") -> list[str]:
        """Return ``name: this | other`` for each value that differs; labels do not count."""
        changes = settings_differences(self._settings(), other._settings())
        return changes + self.code.differences(other.code)

    def _settings(self) -> dict[str, Any]:
        conditions = {condition.name: condition.text for condition in self.conditions}
        return self.model_dump(mode="json", exclude={"code"}) | {"conditions": conditions}


def study_code(operator: OperatorSpec) -> CodeVersion:
    """Return the version of the code that decides what a trial of an operator comes to."""
    return operator_code(operator, "lab.studies.latency.trial")
