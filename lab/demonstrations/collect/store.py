"""A data set's directory: one file an episode, written whole or not at all, and an index.

    dataset.json             the recipe, and which code made them
    index.jsonl              a line a trial, by seed; can be rebuilt from the files
    episodes/000012.h5       an episode that was kept
    rejected/000013.json     a trial that was not: its description only

The files are the truth. A trial is done when its file is there; the index is convenience.
"""

import errno
import hashlib
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from common.episodes.episode_file import EpisodeMeta, open_episode, parse_meta
from common.episodes.errors import EpisodeError
from common.errors import ConfigError
from common.files import PART, alone, write_whole
from lab.demonstrations.collect.dataset import RECIPE, Build, DatasetFile, read_dataset
from lab.demonstrations.collect.recipe import EpisodeConfig

INDEX, EPISODES, REJECTED = "index.jsonl", "episodes", "rejected"
_LOCK = ".lock"
DAMAGED = (KeyError, MemoryError, OSError, RuntimeError, TypeError, ValueError)
"""What h5py raises where bytes of a file are wrong, besides what :mod:`fileformat` makes of it."""


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


@contextmanager
def _disk(path: Path, does: str = "write") -> Iterator[None]:
    """What the disk refuses, in words."""
    try:
        yield
    except OSError as error:
        more = {
            errno.ENOSPC: "; make room and give the same command again, what is done is kept",
            errno.EDQUOT: "; your quota is used up: make room and give the same command again",
            errno.EROFS: "; choose another --out",
            errno.EACCES: "; expected a directory you may write to: choose another --out",
            errno.ENOTDIR: "; expected a directory, got a file: choose another --out",
            errno.EEXIST: "; expected a directory, got a file: choose another --out",
            errno.ENAMETOOLONG: "; choose another --out",
        }.get(error.errno or 0, "; what is done is kept")
        raise EpisodeError(f"cannot {does} {path}: {error.strerror or error}{more}") from error


def _write(path: Path, content: bytes) -> None:
    """Write a file whole or not at all.

    Raises:
        EpisodeError: the disk is full, or the file may not be written.
    """
    with _disk(path):
        write_whole(path, content)


class Store:
    """A data set on disk.

    Attributes:
        root: its directory.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def recipe(self) -> EpisodeConfig | None:
        """What its episodes are made from; None: nothing is there yet.

        Raises:
            EpisodeError: its file is wrong.
        """
        file = read_dataset(self.root)
        return None if file is None else file.recipe

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Be the only one that writes here; the directory has to be there.

        Raises:
            EpisodeError: somebody else writes here, or nobody may.
        """
        with ExitStack() as stack:
            with _disk(self.root / _LOCK):
                stack.enter_context(alone(self.root / _LOCK, EpisodeError))
            yield

    @contextmanager
    def writing(
        self, recipe: EpisodeConfig, build: Build, accept: bool = False, seed: int | None = None
    ) -> Iterator[int]:
        """Be the only one that writes here; begin the data set, or go on with it.

        Args:
            recipe: of the episodes.
            build: the code that makes them.
            accept: that it is other code than that of the episodes there.
            seed: of the first trial; None: as it was begun, a new one with 0.

        Returns:
            the seed of the first trial.

        Raises:
            ConfigError: it was begun with another recipe or seed, or by other code.
            EpisodeError: somebody else writes here, or nobody can.
        """
        with _disk(self.root):
            self.root.mkdir(parents=True, exist_ok=True)
        with self.locked():
            yield self._begin(recipe, build, accept, seed)

    def _begin(self, recipe: EpisodeConfig, build: Build, accept: bool, seed: int | None) -> int:
        known = read_dataset(self.root)
        if known is None and self.files():
            raise EpisodeError(
                f"{self.root} has episodes but no {RECIPE}; put it back from a copy, or choose "
                "another --out"
            )
        if known is None:
            file = DatasetFile(recipe=recipe, builds=(build,), first_seed=seed or 0)
        else:
            file = known if known.first_seed is not None else self._dated(known, seed)
            file = file.begun_at(self.root, seed)
            file = file.agreed(self.root, recipe, build, accept)
        with _disk(self.root):
            for folder in (EPISODES, REJECTED):
                (self.root / folder).mkdir(exist_ok=True)
            # Not below others: an export beside the episodes keeps what is its own.
            for place in (self.root, self.root / EPISODES, self.root / REJECTED):
                for torn in place.glob(f"*{PART}"):
                    if torn.is_file():
                        torn.unlink()
        if file != known:
            _write(self.root / RECIPE, file.content())
        return file.first_seed or 0

    def _dated(self, file: DatasetFile, seed: int | None) -> DatasetFile:
        """The file of an earlier version, which does not say its first seed, with it.

        Raises:
            ConfigError: it can only be guessed; the first trial may be what a kill has left out.
        """
        seeds = {int(path.stem) for path in self.files() if path.stem.isdecimal()}
        with suppress(EpisodeError):
            seeds.update(line.meta.seed for line in self.index())
        if seed is None and seeds and min(seeds) > 0:
            raise ConfigError(
                f"{self.root} does not say which seed it was begun with, and there is none before "
                f"{min(seeds)}: give --seed, this once"
            )
        first = min(seeds | ({seed} if seed is not None else set()), default=0)
        return file.model_copy(update={"first_seed": first})

    def add(self, meta: EpisodeMeta, content: bytes | None) -> IndexLine:
        """Keep a trial: its episode, or only its description."""
        kept = content is not None
        name = f"{EPISODES}/{meta.seed:06d}.h5" if kept else f"{REJECTED}/{meta.seed:06d}.json"
        data = content if content is not None else (meta.model_dump_json() + "\n").encode()
        _write(self.root / name, data)
        line = _line(name, data, meta)
        with _disk(self.root / INDEX), (self.root / INDEX).open("a", encoding="utf-8") as index:
            index.write(line.model_dump_json() + "\n")
        return line

    def read(self, path: Path) -> IndexLine:
        """A trial's line from its file.

        Raises:
            EpisodeError: the file is damaged, or is not the trial its name says.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise EpisodeError(f"cannot read {path}: {error.strerror}") from error
        if path.suffix == ".h5":
            meta = read_meta(path)
        else:
            meta = parse_meta(path, content.decode(errors="replace"))
        if path.stem != f"{meta.seed:06d}":
            raise EpisodeError(f"{path}: expected the trial its name says, got seed {meta.seed}")
        return _line(str(path.relative_to(self.root)), content, meta)

    def scan(self, each: Callable[[], None] = lambda: None) -> list[IndexLine]:
        """Read every file and return the index, by seed.

        Args:
            each: called after each file.

        Raises:
            EpisodeError: files are damaged or not of this data set, or there is none.
        """
        recipe = self.recipe()
        if recipe is None:
            raise self._none()
        lines, wrong = [], []
        for path in self.files():
            try:
                line = self.read(path)
                if line.meta.recipe != recipe:
                    differences = "; ".join(recipe.differences(line.meta.recipe))
                    wrong.append(f"{path}: of another data set, here | there: {differences}")
                lines.append(line)
            except EpisodeError as error:
                wrong.append(str(error))
            each()
        if wrong:
            raise EpisodeError(
                "damaged or foreign files; move them away, and the same command makes these trials "
                "again:\n  " + "\n  ".join(wrong)
            )
        return sorted(lines, key=lambda line: line.meta.seed)

    def files(self) -> list[Path]:
        """Every trial's file."""
        with _disk(self.root, "read"):
            found = [*(self.root / EPISODES).glob("*.h5"), *(self.root / REJECTED).glob("*.json")]
        # Seeds have six digits or more.
        return sorted(found, key=lambda path: (path.parent, len(path.stem), path.stem))

    def write_index(self, lines: list[IndexLine]) -> None:
        """Replace the index."""
        text = "".join(line.model_dump_json() + "\n" for line in lines)
        _write(self.root / INDEX, text.encode())

    def index(self) -> list[IndexLine]:
        """Read the index, by seed; of a run that was cut off it may lack the last trials.

        Raises:
            EpisodeError: it is not there or damaged, or there is no data set.
        """
        path = self.root / INDEX
        try:
            lines = [
                IndexLine.model_validate_json(text)
                for text in path.read_text(encoding="utf-8").splitlines()
            ]
        except (OSError, ValueError) as error:
            if self.recipe() is None:
                raise self._none() from error
            raise EpisodeError(
                f"{path} cannot be read ({error}); rebuild it with: trill collect --reindex "
                f"{self.root}"
            ) from error
        return sorted(lines, key=lambda line: line.meta.seed)

    def _none(self) -> EpisodeError:
        return EpisodeError(
            f"no data set in {self.root}: expected a directory with {RECIPE}, as `trill collect` "
            "makes"
        )


def read_meta(path: Path) -> EpisodeMeta:
    """What is known of the episode in a file.

    Raises:
        EpisodeError: it is none, of another version, or damaged.
    """
    try:
        with open_episode(path) as episode:
            return episode.meta
    except DAMAGED as error:
        raise EpisodeError(f"cannot read {path} as an episode, it is damaged: {error}") from error


def _line(name: str, content: bytes, meta: EpisodeMeta) -> IndexLine:
    return IndexLine(
        file=name,
        kept=name.endswith(".h5"),
        bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        meta=meta,
    )
