"""Describes one trial of a task in simulated time: its settings, and its result."""

from collections.abc import Mapping, Sequence
from statistics import median
from typing import Annotated, Any, Literal, TypeVar

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Field,
    ValidationError,
    model_validator,
)

from common.errors import ConfigError, explain
from common.links.config import Links
from lab.trials.operators.specs import NOT_DECIDING, OperatorSpec, SyntheticSpec

M = TypeVar("M", bound=BaseModel)

FALL = "the robot fell"
"""Reason of the judge when the robot has fallen."""


def _check_links(links: Mapping[str, str]) -> dict[str, str]:
    try:
        Links.from_table(links)
    except ConfigError as error:
        raise ValueError(str(error)) from error
    return dict(sorted(links.items()))


LinkTable = Annotated[Mapping[str, str], AfterValidator(_check_links)]
"""Injected delays by name, for instance ``{"both": "250ms"}``, sorted by name."""


class TrialSettings(BaseModel):
    """Settings of robot and operator that all trials of a campaign share.

    Attributes:
        operator: who operates the robot.
        torque_mode: torque limits of plant and controller.
        pace: pace of the gaits, as in :func:`services.wbc.config.wbc_config`; empty: the torque
            mode's own.
        physics_steps: physics steps in one step of the plant's service; more is faster, but the
            robot hears commands later.
        task_spread: factor on what the starts of the task vary by.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    operator: OperatorSpec = SyntheticSpec()
    torque_mode: Literal["relaxed", "rated"] = "relaxed"
    pace: Literal["", "fast", "normal", "slow", "public"] = ""
    physics_steps: int = Field(default=1, ge=1, le=10)
    task_spread: float = Field(default=1.0, ge=0.0, le=10.0)

    @model_validator(mode="before")
    @classmethod
    def _of_one_operator(cls, values: Any) -> Any:
        """Read settings from when the synthetic operator was the only one."""
        if not isinstance(values, Mapping) or "traits" not in values:
            return values
        others = {name: value for name, value in values.items() if name != "traits"}
        return {"operator": {"kind": "synthetic", "traits": values["traits"]}} | others


class TrialSpec(TrialSettings):
    """Everything that decides how one trial goes.

    Attributes:
        task: name of the task, for instance ``door/unlock``.
        seed: seed of the start, the noise, the links and the operator alike.
        links: injected delays, and no others; None: the task's own links.
        raw_hands: whether the controller uses hand set-points without interpolation.
    """

    task: str
    seed: int = Field(ge=0)
    links: LinkTable | None = None
    raw_hands: bool = False

    def __str__(self) -> str:
        return f"{self.task} with seed {self.seed}"

    @property
    def key(self) -> str:
        """The same text for trials that go the same."""
        return self.model_dump_json(exclude={"operator": dict(NOT_DECIDING)})


class TrialResult(BaseModel):
    """The result of a trial.

    Attributes:
        task: name of the task.
        seed: seed of the trial.
        verdict: verdict of the task's judge.
        time: robot time until the verdict [s].
        reason: the judge's reason.
        gave_up: why the operator ended early; empty: it did not.
        doing: what the operator was doing at the end.
        stages: names of the stages that were completed.
        simulated: robot time that was run in all [s].
        wall: wall-clock time that this took [s].
        links: delays under which the trial ran.
        still: time until the verdict in which neither a set-point moved nor the robot walked [s];
            None: not measured.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    task: str
    seed: int
    verdict: str
    time: float
    reason: str
    gave_up: str = ""
    doing: str = ""
    stages: tuple[str, ...] = ()
    simulated: float = 0.0
    wall: float = 0.0
    links: Mapping[str, str] = Field(default_factory=dict)
    still: float | None = None

    @property
    def fell(self) -> bool:
        """Whether the robot fell before the verdict."""
        return self.reason == FALL


def format_spread(times: Sequence[float]) -> str:
    """Format times as median and range, ``8.5 (6.0 to 10.0)``; empty without any."""
    return f"{median(times):.1f} ({min(times):.1f} to {max(times):.1f})" if times else ""


def validated(model: type[M], values: Mapping[str, Any]) -> M:
    """Return the model with these values, which come from options or a file.

    Raises:
        ConfigError: a value is wrong.
    """
    try:
        return model.model_validate(values)
    except ValidationError as error:
        raise ConfigError(explain(error)) from error


def settings_differences(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return ``name: one | other`` for each value that differs; nested ones as ``group.name``.

    Args:
        one: settings as JSON values.
        other: the settings they are compared with.
    """
    found = []
    for name in dict.fromkeys([*one, *other]):
        here, there = (settings.get(name, "absent") for settings in (one, other))
        if isinstance(here, Mapping) and isinstance(there, Mapping):
            found += [f"{name}.{text}" for text in settings_differences(here, there)]
        elif here != there:
            found.append(f"{name}: {_format(here)} | {_format(there)}")
    return found


def _format(value: Any) -> str:
    if value is None:
        return "none"
    return ", ".join(map(str, value)) if isinstance(value, list) else str(value)
