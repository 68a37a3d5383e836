"""A data set's directory: one file an episode, written whole or not at all, and an index.

    dataset.json             the recipe
    index.jsonl              a line a trial, by seed; can be rebuilt from the files
    episodes/000012.h5       an episode that was kept
    rejected/000013.json     a trial that was not: its description only

The files are the truth. A trial is done when its file is there; the index is convenience.
"""

import fcntl
import hashlib
import json
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from pydantic import BaseModel, ConfigDict, ValidationError

from common.errors import ConfigError, explain
from studies.collect.errors import CollectError
from studies.collect.fileformat import EpisodeMeta, open_episode, parse_meta
from studies.collect.recipe import Recipe

RECIPE, INDEX, EPISODES, REJECTED = "dataset.json", "index.jsonl", "episodes", "rejected"
_LOCK = ".lock"
_TEMPORARY = ".part"


class IndexLine(BaseModel):
    """A trial in the index.

    Attributes:
        file: relative to the data set.
        kept: whether the file is an episode; else only a description.
        bytes: size of the file.
        sha256: of the file.
        meta: what is known of the trial.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    file: str
    kept: bool
    bytes: int
    sha256: str
    meta: EpisodeMeta


def write_whole(path: Path, content: bytes) -> None:
    """Write a file so that it is there whole or not at all, whenever the process is killed."""
    temporary = path.with_name(path.name + _TEMPORARY)
    with temporary.open("wb") as file:
        file.write(content)
        file.flush()
        os.fsync(file.fileno())
    temporary.replace(path)


class Store:
    """A data set on disk.

    Attributes:
        root: its directory.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def recipe(self) -> Recipe | None:
        """What its episodes are made from; None: nothing is there yet.

        Raises:
            CollectError: its file is wrong.
        """
        path = self.root / RECIPE
        try:
            return Recipe.model_validate_json(path.read_bytes())
        except FileNotFoundError:
            return None
        except ValidationError as error:
            raise CollectError(f"{path}: {explain(error)}") from error

    @contextmanager
    def writing(self, recipe: Recipe) -> Iterator[None]:
        """Be the only one that writes here; begin the data set, or go on with it.

        Raises:
            ConfigError: it was begun with another recipe.
            CollectError: somebody else writes here.
        """
        self.root.mkdir(parents=True, exist_ok=True)
        # The system lets go of the lock when the process ends, however it ends.
        with (self.root / _LOCK).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise CollectError(
                    f"{self.root} is being written by another process; wait for it or choose "
                    "another --out"
                ) from error
            self._begin(recipe)
            yield

    def _begin(self, recipe: Recipe) -> None:
        known = self.recipe()
        if known is not None and known != recipe:
            differences = "\n  ".join(known.differences(recipe))
            raise ConfigError(
                f"{self.root} was begun with other options; go on with the same, or choose "
                f"another --out. There | asked for:\n  {differences}"
            )
        for folder in (EPISODES, REJECTED):
            (self.root / folder).mkdir(exist_ok=True)
            for torn in (self.root / folder).glob(f"*{_TEMPORARY}"):
                torn.unlink()
        if known is None:
            content = json.dumps(recipe.model_dump(mode="json"), indent=1) + "\n"
            write_whole(self.root / RECIPE, content.encode())

    def add(self, meta: EpisodeMeta, content: bytes | None) -> IndexLine:
        """Keep a trial: its episode, or only its description."""
        kept = content is not None
        name = f"{EPISODES}/{meta.seed:06d}.h5" if kept else f"{REJECTED}/{meta.seed:06d}.json"
        data = content if content is not None else (meta.model_dump_json() + "\n").encode()
        write_whole(self.root / name, data)
        line = _line(name, data, meta)
        with (self.root / INDEX).open("a", encoding="utf-8") as index:
            index.write(line.model_dump_json() + "\n")
        return line

    def scan(self, each: Callable[[], None] = lambda: None) -> list[IndexLine]:
        """Read every file and return the index, by seed.

        Args:
            each: called after each file.

        Raises:
            CollectError: a file is damaged, or there is no data set.
        """
        if self.recipe() is None:
            raise CollectError(
                f"no data set in {self.root}: expected a directory with {RECIPE}, as `trill "
                "collect` makes"
            )
        lines = []
        for path in self.files():
            content = path.read_bytes()
            if path.suffix == ".h5":
                with open_episode(path) as episode:
                    meta = episode.meta
            else:
                meta = parse_meta(path, content.decode(errors="replace"))
            lines.append(_line(str(path.relative_to(self.root)), content, meta))
            each()
        return sorted(lines, key=lambda line: line.meta.seed)

    def files(self) -> list[Path]:
        """Every trial's file."""
        return sorted(
            [*(self.root / EPISODES).glob("*.h5"), *(self.root / REJECTED).glob("*.json")]
        )

    def write_index(self, lines: list[IndexLine]) -> None:
        """Replace the index."""
        text = "".join(line.model_dump_json() + "\n" for line in lines)
        write_whole(self.root / INDEX, text.encode())

    def index(self) -> list[IndexLine]:
        """Read the index, by seed; of a run that was cut off it may lack the last trials.

        Raises:
            CollectError: it is not there or damaged.
        """
        path = self.root / INDEX
        try:
            lines = [
                IndexLine.model_validate_json(text)
                for text in path.read_text(encoding="utf-8").splitlines()
            ]
        except (OSError, ValidationError) as error:
            raise CollectError(
                f"{path} cannot be read ({error}); rebuild it with: trill collect --reindex "
                f"{self.root}"
            ) from error
        return sorted(lines, key=lambda line: line.meta.seed)


def _line(name: str, content: bytes, meta: EpisodeMeta) -> IndexLine:
    return IndexLine(
        file=name,
        kept=name.endswith(".h5"),
        bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        meta=meta,
    )
