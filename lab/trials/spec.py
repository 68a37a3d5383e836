"""Describes one trial of a task in simulated time: its settings, and its result."""

from collections.abc import Mapping
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator

from services.teleop.synthetic.traits import OperatorTraits


class TrialSettings(BaseModel):
    """Settings of robot and synthetic operator that all trials of a campaign share.

    Attributes:
        traits: parameters of the synthetic operator.
        torque_mode: torque limits of plant and controller.
        pace: pace of the gaits, as in :func:`services.wbc.config.wbc_config`; empty: the torque
            mode's own.
        physics_steps: physics steps in one step of the plant's service; more is faster, but the
            robot hears commands later.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    traits: OperatorTraits = OperatorTraits()
    torque_mode: Literal["relaxed", "rated"] = "relaxed"
    pace: Literal["", "fast", "normal", "slow", "public"] = ""
    physics_steps: int = Field(default=1, ge=1, le=10)


class TrialSpec(TrialSettings):
    """Everything that decides how one trial goes.

    Attributes:
        task: name of the task, for instance ``door/unlock``.
        seed: seed of the start, the noise, the links and the operator alike.
        links: injected delays by name, for instance ``{"both": "250ms"}``, and no others; None:
            the task's own links.
        raw_hands: whether the controller uses hand set-points without interpolation.
    """

    task: str
    seed: int = Field(ge=0)
    links: Mapping[str, str] | None = None
    raw_hands: bool = False

    @field_validator("links")
    @classmethod
    def _sorted(cls, links: Mapping[str, str] | None) -> Mapping[str, str] | None:
        return None if links is None else dict(sorted(links.items()))

    def __str__(self) -> str:
        return f"{self.task} with seed {self.seed}"

    @property
    def key(self) -> str:
        """The same text for equal specifications."""
        return self.model_dump_json()


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
