"""``dataset.json``: the settings of a data set's episodes, and the code that made them."""

from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, ConfigDict, Discriminator, Field, Tag

from common.episodes.errors import EpisodeError
from common.episodes.folder import DATASET
from common.errors import ConfigError
from lab.demonstrations.collect.config import EpisodeConfig
from lab.demonstrations.recorded.config import RecordedConfig
from lab.trials.folder import read_model
from lab.trials.provenance import CodeVersion
from lab.trials.spec import settings_differences


def _kind(config: Any) -> str:
    """Return which settings these are, so that what is wrong is said of them alone."""
    if isinstance(config, dict):
        return "recorded" if "recorded" in config else "trials"
    return "recorded" if isinstance(config, RecordedConfig) else "trials"


class DatasetFile(BaseModel):
    """Content of ``dataset.json``.

    Attributes:
        config: settings of every episode.
        code: versions of the code that made episodes, in order.
        first_seed: seed of the first trial.
        wanted: number of successes that the last run was to reach; 0: unknown.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    config: Annotated[
        Annotated[RecordedConfig, Tag("recorded")] | Annotated[EpisodeConfig, Tag("trials")],
        Discriminator(_kind),
    ]
    code: tuple[CodeVersion, ...] = Field(min_length=1)
    first_seed: int = Field(ge=0)
    wanted: int = Field(default=0, ge=0)

    def continued(
        self, root: Path, config: EpisodeConfig, code: CodeVersion, accept: bool, seed: int | None
    ) -> "DatasetFile":
        """Return the file for adding further episodes.

        Args:
            root: the data set's folder, for messages.
            config: settings of the further episodes.
            code: the code that makes them.
            accept: whether other code than before is accepted.
            seed: first seed that was asked for; None: as before.

        Raises:
            ConfigError: the data set was begun with other settings or another seed, or by other
                code that is not accepted.
        """
        if seed not in {None, self.first_seed}:
            raise ConfigError(
                f"{root} was begun with --seed {self.first_seed}, not {seed}; leave --seed out, or "
                "choose another --out"
            )
        if self.config != config:
            differences = "\n  ".join(settings_differences(self.config.origin(), config.origin()))
            raise ConfigError(
                f"{root} was begun with other options; go on with the same, or choose another "
                f"--out. There | asked for:\n  {differences}"
            )
        changes = self.code[-1].differences(code)
        if not changes:
            return self
        if not accept:
            raise ConfigError(
                f"{root} was begun by other code; further episodes could be of another robot or "
                "operator. Go on with that code, choose another --out, or mix them knowingly with "
                "--accept-changes (each episode says which code made it). There | here:\n  "
                + "\n  ".join(changes)
            )
        return self.model_copy(update={"code": (*self.code, code)})


def read_dataset(root: Path) -> DatasetFile | None:
    """Read the file in ``root``; None: there is none.

    Raises:
        EpisodeError: it is wrong.
    """
    return read_model(root / DATASET, DatasetFile, EpisodeError)
