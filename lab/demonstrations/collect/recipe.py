"""What an episode is made from: all that decides its bytes but the seed."""

import platform
from collections.abc import Mapping
from typing import Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, field_validator, model_validator

from common.errors import ConfigError, explain
from common.links.config import Links
from lab.trials.links import links_used
from lab.trials.provenance import PHYSICS, digest, package_versions
from lab.trials.stack import TrialSpec
from services.sim.rendering.cameras import CameraConfig
from services.sim.tasks import find_task
from services.teleop.synthetic.traits import OperatorTraits

PACKAGES = (*PHYSICS, "opencv-python-headless", "h5py", "pydantic")
"""Whose versions can change an episode."""


class Eyes(BaseModel):
    """How the stereo pictures are rendered and kept."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    width: int = Field(default=400, ge=16, le=1920, description="[pixels]")
    height: int = Field(default=300, ge=16, le=1080, description="[pixels]")
    quality: int = Field(default=90, ge=1, le=100, description="of JPEG")

    def camera(self, scene: str) -> CameraConfig:
        """The renderer's configuration."""
        return CameraConfig(scene=scene, width=self.width, height=self.height, quality=self.quality)


class EpisodeConfig(BaseModel):
    """Everything but the seed that an episode depends on.

    Attributes:
        task: for instance ``door/unlock``.
        traits: of the synthetic operator.
        links: injected delays by name, as ``{"both": "250ms"}``; if not given, or None, the
            task's own is put here.
        torque_mode: torque limits of plant and controller.
        pace: of the gaits; empty: as the torque mode has it.
        raw_hands: no interpolation of the hand set-points.
        physics_steps: physics steps a step of the plant's service.
        eyes: the pictures; None: none.
        keep_failures: whether episodes that are no success are kept too.
    """

    model_config = ConfigDict(frozen=True, extra="forbid", allow_inf_nan=False)

    task: str
    traits: OperatorTraits = OperatorTraits()
    links: Mapping[str, str] = Field(default_factory=dict)
    torque_mode: Literal["relaxed", "rated"] = "relaxed"
    pace: Literal["", "fast", "normal", "slow", "public"] = ""
    raw_hands: bool = False
    physics_steps: int = Field(default=1, ge=1, le=5)
    eyes: Eyes | None = Eyes()
    keep_failures: bool = False

    @model_validator(mode="before")
    @classmethod
    def _own_link(cls, values: Any) -> Any:
        if not isinstance(values, Mapping) or values.get("links") is not None:
            return values
        task = values.get("task")
        return {**values, "links": links_used(task, None)} if isinstance(task, str) else values

    @field_validator("links")
    @classmethod
    def _known(cls, links: Mapping[str, str]) -> Mapping[str, str]:
        try:
            Links.from_table(links)
        except ConfigError as error:
            raise ValueError(str(error)) from error
        return dict(sorted(links.items()))

    @classmethod
    def checked(cls, values: Mapping[str, Any]) -> Self:
        """Check options or a file's content.

        Raises:
            ConfigError: a value is wrong.
            TaskError: there is no such task.
        """
        try:
            recipe = cls.model_validate(values)
        except ValidationError as error:
            raise ConfigError(explain(error)) from error
        find_task(recipe.task)
        return recipe

    def trial(self, seed: int) -> TrialSpec:
        """The trial with this seed."""
        return TrialSpec(
            task=self.task,
            seed=seed,
            traits=self.traits,
            links=self.links,
            mode=self.torque_mode,
            pace=self.pace,
            raw_hands=self.raw_hands,
            physics_steps=self.physics_steps,
        )

    def differences(self, other: Self) -> list[str]:
        """``name: this | other`` for each value that differs."""
        mine, theirs = self.model_dump(mode="json"), other.model_dump(mode="json")
        return [f"{n}: {mine[n]} | {theirs[n]}" for n in mine if mine[n] != theirs[n]]


def source() -> str:
    """Digest of the code of this project that decides an episode's bytes."""
    return digest("lab.demonstrations.collect.episode")


def versions() -> dict[str, str]:
    """Version of each package in :data:`PACKAGES` that is installed, and of Python."""
    return {"python": platform.python_version()} | package_versions(PACKAGES)
