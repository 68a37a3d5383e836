"""``dataset.json``: what a data set's episodes are made from, and by which code."""

import json
from pathlib import Path

from pydantic import BaseModel, ConfigDict, Field, ValidationError

from common.episodes.errors import EpisodeError
from common.errors import ConfigError, explain
from lab.demonstrations.collect.recipe import EpisodeConfig, source, versions
from lab.trials.provenance import revision

RECIPE = "dataset.json"


class Build(BaseModel):
    """The code that makes episodes.

    Attributes:
        source: digest of this project's part in it.
        versions: of the packages it uses.
        revision: of the clone, for people: it is in no episode, and the same source may have many.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: str
    versions: dict[str, str]
    revision: str = ""

    @classmethod
    def here(cls) -> "Build":
        """The code that runs now."""
        return cls(source=source(), versions=versions(), revision=revision())

    def differences(self, other: "Build") -> list[str]:
        """``name: this | other`` for each part that can change an episode."""
        found = []
        if self.source != other.source:
            named = [f"{b.source[:12]} {b.revision}".strip() for b in (self, other)]
            found.append(f"source: {named[0]} | {named[1]}")
        packages = sorted({*self.versions, *other.versions})
        return found + [
            f"{name}: {self.versions.get(name, 'none')} | {other.versions.get(name, 'none')}"
            for name in packages
            if self.versions.get(name) != other.versions.get(name)
        ]


class DatasetFile(BaseModel):
    """Content of ``dataset.json``.

    Attributes:
        recipe: of every episode.
        builds: that have made some, in order; empty: unknown, the file is of an earlier version.
        first_seed: of the first trial; None: unknown, the file is of an earlier version.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    recipe: EpisodeConfig
    builds: tuple[Build, ...] = ()
    first_seed: int | None = Field(default=None, ge=0)

    def content(self) -> bytes:
        """Of the file."""
        return (json.dumps(self.model_dump(mode="json"), indent=1) + "\n").encode()

    def agreed(
        self, root: Path, recipe: EpisodeConfig, build: Build, accept: bool
    ) -> "DatasetFile":
        """The file if episodes of ``recipe`` made by ``build`` come to those in ``root``.

        Raises:
            ConfigError: they would be others, and ``accept`` does not allow for it.
        """
        if self.recipe != recipe:
            differences = "\n  ".join(self.recipe.differences(recipe))
            raise ConfigError(
                f"{root} was begun with other options; go on with the same, or choose another "
                f"--out. There | asked for:\n  {differences}"
            )
        changes = self.builds[-1].differences(build) if self.builds else ["source: unknown"]
        if not changes:
            return self
        if not accept:
            raise ConfigError(
                f"{root} was begun by other code; further episodes could be of another robot or "
                "operator. Go on with that code, choose another --out, or mix them knowingly with "
                "--accept-changes (each episode says which code made it). There | here:\n  "
                + "\n  ".join(changes)
            )
        return self.model_copy(update={"builds": (*self.builds, build)})

    def begun_at(self, root: Path, seed: int | None) -> "DatasetFile":
        """The file if trials from ``seed`` on (None: as before) come to those in ``root``.

        Raises:
            ConfigError: those there begin at another seed.
        """
        if seed is None or seed == self.first_seed:
            return self
        raise ConfigError(
            f"{root} was begun with --seed {self.first_seed}, not {seed}; leave --seed out, or "
            "choose another --out"
        )


def read_dataset(root: Path) -> DatasetFile | None:
    """The file in ``root``; None: nothing is there.

    Raises:
        EpisodeError: it is wrong.
    """
    path = root / RECIPE
    try:
        text = path.read_bytes()
        try:
            return DatasetFile.model_validate_json(text)
        except ValidationError:
            if b'"recipe"' in text:
                raise
            # Of an earlier version, or so damaged that both say the same.
            return DatasetFile(recipe=EpisodeConfig.model_validate_json(text))
    except FileNotFoundError:
        return None
    except OSError as error:
        raise EpisodeError(f"cannot read {path}: {error.strerror}") from error
    except ValidationError as error:
        raise EpisodeError(f"{path}: {explain(error)}") from error
