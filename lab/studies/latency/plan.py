"""What a study consists of: everything that decides its figures but the number of episodes."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Self

from pydantic import Field, ValidationError, model_validator

from common.errors import ConfigError, explain
from lab.studies.latency.conditions import BASELINE, Condition
from lab.trials.provenance import PHYSICS, digest, package_versions
from lab.trials.spec import TrialSettings, TrialSpec
from services.sim.tasks import find_task

DEFAULT_TASKS = ("door/unlock", "bench/hammer")
"""The two manipulation tasks in simulation."""


@dataclass(frozen=True, order=True)
class TrialKey:
    """Identifies one trial of the study.

    The order is that in which trials are run: a study that was cut off has every condition with
    the same seeds.
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
        first_seed: seed of the first trial of each; the next trial has the next seed.
        versions: versions of the packages that can change a trial, and a digest of the source.
    """

    tasks: tuple[str, ...] = Field(default=DEFAULT_TASKS, min_length=1)
    conditions: tuple[Condition, ...] = Field(min_length=1)
    first_seed: int = Field(default=0, ge=0)
    versions: dict[str, str] = Field(default_factory=dict)

    @model_validator(mode="after")
    def _different(self) -> Self:
        names = [condition.name for condition in self.conditions]
        if len(set(names)) != len(names) or len(set(self.tasks)) != len(self.tasks):
            raise ValueError(f"each task and condition once; got {list(self.tasks)} and {names}")
        return self

    @classmethod
    def checked(cls, values: dict[str, Any]) -> Self:
        """Check options.

        Raises:
            ConfigError: a value is wrong.
            TaskError: there is no such task.
        """
        try:
            plan = cls.model_validate({"versions": versions()} | values)
        except ValidationError as error:
            raise ConfigError(explain(error)) from error
        for task in plan.tasks:
            find_task(task)
        return plan

    @property
    def baseline(self) -> Condition:
        """What the others are compared with.

        The final set-up, if it is among them; else the first with interpolation and no delay; else
        the first.
        """
        named = [c for c in self.conditions if c.name == BASELINE]
        plain = [c for c in self.conditions if not c.links and not c.raw_hands]
        return (named + plain + list(self.conditions))[0]

    def condition(self, name: str) -> Condition:
        """One of the conditions.

        Raises:
            ConfigError: there is none of this name.
        """
        for condition in self.conditions:
            if condition.name == name:
                return condition
        known = ", ".join(condition.name for condition in self.conditions)
        raise ConfigError(f"no condition {name!r} in this study; expected one of {known}")

    def trials(self, episodes: int) -> Iterator[TrialKey]:
        """Every trial, in the order in which they are run."""
        for seed in range(self.first_seed, self.first_seed + episodes):
            for task in self.tasks:
                for condition in self.conditions:
                    yield TrialKey(seed, task, condition.name)

    def spec(self, key: TrialKey) -> TrialSpec:
        """The trial of a key; its links are the condition's alone, not the task's own."""
        condition = self.condition(key.condition)
        return TrialSpec(
            task=key.task,
            seed=key.seed,
            traits=self.traits,
            links=condition.links,
            torque_mode=self.torque_mode,
            pace=self.pace,
            raw_hands=condition.raw_hands,
            physics_steps=self.physics_steps,
        )

    def differences(self, other: "Plan") -> list[str]:
        """``name: this | other`` for each value that differs."""
        mine, theirs = _flat(self), _flat(other)
        told = []
        for name in dict.fromkeys([*mine, *theirs]):
            here, there = mine.get(name, "none"), theirs.get(name, "none")
            if here != there:
                hint = "; the system's code is another" if name == "versions.source" else ""
                told.append(f"{name}: {here} | {there}{hint}")
        return told


def _flat(plan: Plan) -> dict[str, str]:
    """Each value by itself, conditions by name."""
    flat: dict[str, str] = {}
    for name, value in plan.model_dump(mode="json").items():
        if name == "conditions":
            flat |= {f"condition {part['name']}": _short(part) for part in value}
            flat["conditions"] = ", ".join(part["name"] for part in value)
        elif isinstance(value, dict):
            flat |= {f"{name}.{key}": str(part) for key, part in value.items()}
        else:
            flat[name] = ", ".join(value) if isinstance(value, list) else str(value)
    return flat


def _short(condition: dict[str, Any]) -> str:
    links = [f"{name}={spec}" for name, spec in condition["links"].items()]
    return ", ".join([*links, *(["raw"] if condition["raw_hands"] else [])]) or "no delay"


def source() -> str:
    """Which code runs the trials, in short."""
    return digest("lab.studies.latency.trial")[:12]


def versions() -> dict[str, str]:
    """Versions of what can change a trial: packages, and a digest of this system's own source."""
    return {"source": source()} | package_versions(("trill", *PHYSICS))
