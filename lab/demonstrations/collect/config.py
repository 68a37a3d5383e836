"""Settings of an episode: everything but the seed that decides its bytes."""

from collections.abc import Mapping
from typing import Any, Self

from pydantic import BaseModel, ConfigDict, Field, model_validator

from common.episodes.episode_file import EpisodeMeta
from common.errors import TrillError
from lab.trials.links import links_used
from lab.trials.operators.kinds import operator_code
from lab.trials.operators.specs import HelpedSpec, OperatorSpec
from lab.trials.provenance import PHYSICS, CodeVersion
from lab.trials.spec import LinkTable, TrialSettings, TrialSpec, validated
from services.sim.rendering.cameras import CameraConfig
from services.sim.tasks import find_task

PACKAGES = (*PHYSICS, "opencv-python-headless", "h5py", "pydantic")
"""Packages whose versions can change an episode."""


class PictureConfig(BaseModel):
    """How the stereo pictures of an episode are rendered and encoded."""

    model_config = ConfigDict(frozen=True, extra="forbid")

    width: int = Field(default=400, ge=16, le=1920, description="width [pixels]")
    height: int = Field(default=300, ge=16, le=1080, description="height [pixels]")
    quality: int = Field(default=90, ge=1, le=100, description="JPEG quality")

    def camera(self, scene: str) -> CameraConfig:
        """Return the renderer's configuration for a scene."""
        return CameraConfig(scene=scene, width=self.width, height=self.height, quality=self.quality)


class EpisodeConfig(TrialSettings):
    """Everything but the seed that an episode depends on.

    Attributes:
        task: name of the task, for instance ``door/unlock``.
        links: injected delays; if not given, or None, the task's own links are put here.
        raw_hands: whether the controller uses hand set-points without interpolation.
        pictures: how pictures are made; None: there are none.
        keep_failures: whether episodes that are no success are kept too.
    """

    task: str
    links: LinkTable = Field(default_factory=dict)
    raw_hands: bool = False
    pictures: PictureConfig | None = PictureConfig()
    keep_failures: bool = False

    @model_validator(mode="before")
    @classmethod
    def _own_link(cls, values: Any) -> Any:
        if not isinstance(values, Mapping) or values.get("links") is not None:
            return values
        task = values.get("task")
        return {**values, "links": links_used(task, None)} if isinstance(task, str) else values

    @classmethod
    def checked(cls, values: Mapping[str, Any]) -> Self:
        """Return the settings with these values, which come from options or a file.

        Raises:
            ConfigError: a value is wrong.
            TaskError: there is no such task.
        """
        config = validated(cls, values)
        find_task(config.task)
        return config

    @model_validator(mode="after")
    def _ages_as_of_the_policy(self) -> Self:
        of_policy = [name for name in self.links if name.startswith("policy:")]
        if self.helped and of_policy:
            raise ValueError(
                f"{', '.join(of_policy)}: expected links of all services where a policy operates "
                "the robot, as camera=80ms: its pictures are recorded as these make them old"
            )
        return self

    @property
    def helped(self) -> bool:
        """Whether a policy operates the robot, and another operator takes over from it."""
        return isinstance(self.operator, HelpedSpec)

    @classmethod
    def of(cls, meta: EpisodeMeta) -> Self:
        """Return the settings of an episode that was collected.

        Raises:
            ConfigError: its origin is another.
        """
        return cls.checked(meta.origin)

    def origin(self) -> dict[str, Any]:
        """Return the settings as JSON, as an episode's metadata holds them."""
        return self.model_dump(mode="json")

    def trial(self, seed: int) -> TrialSpec:
        """Return the trial with this seed."""
        names = set(TrialSpec.model_fields) - {"seed"}
        return TrialSpec(seed=seed, **{name: getattr(self, name) for name in names})


def origin_of(meta: EpisodeMeta) -> dict[str, Any]:
    """Return the origin of an episode as this version writes it; another's as it is."""
    try:
        return EpisodeConfig.of(meta).origin()
    except TrillError:
        return meta.origin


def collecting_code(operator: OperatorSpec) -> CodeVersion:
    """Return the version of the code that decides an episode's bytes."""
    return operator_code(operator, "lab.demonstrations.collect.episode", packages=PACKAGES)
