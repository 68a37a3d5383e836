"""Writes a data set's folder: each trial's file whole or not at all, and the index.

The layout is in :mod:`common.episodes.folder`.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path

from common.episodes.episode_file import EpisodeMeta, parse_meta
from common.episodes.errors import EpisodeAccessError, EpisodeError
from common.episodes.folder import (
    DATASET,
    EPISODES,
    INDEX,
    REJECTED,
    IndexLine,
    index_line,
    read_meta,
    trial_files,
)
from common.errors import ConfigError
from common.files import PART
from lab.demonstrations.collect.config import EpisodeConfig, origin_of
from lab.demonstrations.collect.dataset import DatasetFile, read_dataset
from lab.demonstrations.recorded.config import RecordedConfig
from lab.trials.folder import disk_errors, locked_folder, write_file, write_model
from lab.trials.provenance import CodeVersion
from lab.trials.spec import settings_differences


class DatasetStore:
    """A data set on disk.

    Attributes:
        root: its folder.
    """

    def __init__(self, root: Path) -> None:
        self.root = root

    def config(self) -> EpisodeConfig | RecordedConfig:
        """Return the settings of its episodes.

        Raises:
            EpisodeError: there is no data set, or its file is wrong.
        """
        file = read_dataset(self.root)
        if file is None:
            raise EpisodeError(
                f"no data set in {self.root}: expected a directory with {DATASET}, as `trill "
                "collect` makes"
            )
        return file.config

    def locked(self) -> AbstractContextManager[None]:
        """Be the only process that writes here.

        Raises:
            EpisodeError: another process writes here, or it cannot be written.
        """
        return locked_folder(self.root, EpisodeError)

    @contextmanager
    def writing(
        self,
        config: EpisodeConfig,
        code: CodeVersion,
        accept: bool = False,
        seed: int | None = None,
        wanted: int = 0,
    ) -> Iterator[int]:
        """Begin the data set, or continue it, as the only process that writes here.

        Args:
            config: settings of the episodes.
            code: the code that makes them.
            accept: whether to accept that other code made the episodes there.
            seed: seed of the first trial; None: as it was begun, 0 for a new data set.
            wanted: number of successes that this run is to reach; an export compares with it.

        Returns:
            the seed of the first trial.

        Raises:
            ConfigError: it was begun with other settings or another seed, or by other code.
            EpisodeError: another process writes here, or the folder cannot be written.
        """
        with self.locked():
            yield self._begin(config, code, accept, seed, wanted)

    def _begin(
        self, config: EpisodeConfig, code: CodeVersion, accept: bool, seed: int | None, wanted: int
    ) -> int:
        known = read_dataset(self.root)
        if known is not None:
            file = known.continued(self.root, config, code, accept, seed)
        elif self.files():
            raise EpisodeError(
                f"{self.root} has episodes but no {DATASET}; put it back from a copy, or choose "
                "another --out"
            )
        else:
            file = DatasetFile(config=config, code=(code,), first_seed=seed or 0)
        self._make_folders()
        with disk_errors(self.root, EpisodeError):
            # Not below other folders: an export beside the episodes keeps its own files.
            for place in (self.root, self.root / EPISODES, self.root / REJECTED):
                for torn in place.glob(f"*{PART}"):
                    if torn.is_file():
                        torn.unlink()
        file = file.model_copy(update={"wanted": wanted})
        if file != known:
            write_model(self.root / DATASET, file, EpisodeError)
        return file.first_seed

    def adding(self, config: RecordedConfig, code: CodeVersion, *, mix: bool) -> RecordedConfig:
        """Begin a data set of recorded episodes, or go on with it, as the holder of the lock.

        Args:
            config: settings of one episode more.
            code: the code that made it.
            mix: whether it may be by another kind of operator than those there.

        Returns:
            the settings of the data set.

        Raises:
            ConfigError: it does not fit the episodes there.
            EpisodeError: the folder cannot be written.
        """
        known = read_dataset(self.root)
        if known is None:
            known = DatasetFile(config=config, code=(code,), first_seed=0)
        there = known.config
        if not isinstance(there, RecordedConfig):
            raise ConfigError(
                f"{self.root} has simulated trials, which cannot be mixed with recorded ones; "
                "choose another --out: trill train takes several --data"
            )
        if differences := settings_differences(there.origin(), config.origin()):
            raise ConfigError(
                f"{self.root} has other episodes; choose another --out. There | asked for:\n  "
                + "\n  ".join(differences)
            )
        joined = there.with_operator(config.operators[0], mix=mix)
        joined = joined.model_copy(
            update={"keep_failures": there.keep_failures or config.keep_failures}
        )
        codes = known.code if not known.code[-1].differences(code) else (*known.code, code)
        self._make_folders()
        file = known.model_copy(update={"config": joined, "code": codes})
        write_model(self.root / DATASET, file, EpisodeError)
        return joined

    def _make_folders(self) -> None:
        with disk_errors(self.root, EpisodeError):
            for folder in (EPISODES, REJECTED):
                (self.root / folder).mkdir(exist_ok=True)

    def add(self, meta: EpisodeMeta, content: bytes | None) -> IndexLine:
        """Write the file of a trial, its episode or only its metadata, and extend the index."""
        kept = content is not None
        name = f"{EPISODES}/{meta.seed:06d}.h5" if kept else f"{REJECTED}/{meta.seed:06d}.json"
        data = content if content is not None else (meta.model_dump_json() + "\n").encode()
        write_file(self.root / name, data, EpisodeError)
        line = index_line(name, data, meta)
        with disk_errors(self.root / INDEX, EpisodeError), (self.root / INDEX).open("ab") as index:
            index.write(line.model_dump_json().encode() + b"\n")
        return line

    def read(self, path: Path) -> IndexLine:
        """Return a trial's index line from its file.

        Raises:
            EpisodeError: the file cannot be reached or is damaged, or its name is that of another
                trial.
        """
        try:
            content = path.read_bytes()
        except OSError as error:
            raise EpisodeAccessError(f"cannot read {path} now: {error.strerror}") from error
        if path.suffix == ".h5":
            meta = read_meta(path)
        else:
            meta = parse_meta(path, content.decode(errors="replace"))
        if path.stem != f"{meta.seed:06d}":
            raise EpisodeError(f"{path}: expected the trial of its name, got seed {meta.seed}")
        return index_line(str(path.relative_to(self.root)), content, meta)

    def scan(self, on_file: Callable[[], None] = lambda: None) -> list[IndexLine]:
        """Read every file and return the index, by seed.

        Args:
            on_file: called after each file.

        Raises:
            EpisodeError: files cannot be reached, are damaged or of another data set, or there is
                no data set.
        """
        origin = self.config().origin()
        lines: list[IndexLine] = []
        wrong: list[str] = []
        unreachable: list[str] = []
        for path in self.files():
            try:
                line = self.read(path)
                if differences := settings_differences(origin, origin_of(line.meta)):
                    wrong.append(
                        f"{path}: of another data set, here | there: {'; '.join(differences)}"
                    )
                lines.append(line)
            except EpisodeAccessError as error:
                unreachable.append(str(error))
            except EpisodeError as error:
                wrong.append(str(error))
            on_file()
        if unreachable:
            raise EpisodeAccessError(
                "files that cannot be reached now; leave them where they are, mend this and give "
                "the same command again:\n  " + "\n  ".join(unreachable)
            )
        if wrong:
            raise EpisodeError(
                "damaged or foreign files; move them away, and the same command makes these trials "
                "again:\n  " + "\n  ".join(wrong)
            )
        return sorted(lines, key=lambda line: line.meta.seed)

    def files(self) -> list[Path]:
        """Return the files of all trials."""
        with disk_errors(self.root, EpisodeError, "read"):
            return trial_files(self.root)

    def write_index(self, lines: list[IndexLine]) -> None:
        """Replace the index."""
        text = "".join(line.model_dump_json() + "\n" for line in lines)
        write_file(self.root / INDEX, text.encode(), EpisodeError)

    def index(self) -> list[IndexLine]:
        """Read the index, by seed; after a run that was cut off it may lack the last trials.

        Raises:
            EpisodeError: it is missing or damaged, or there is no data set.
        """
        self.config()
        path = self.root / INDEX
        try:
            lines = [
                IndexLine.model_validate_json(text)
                for text in path.read_text(encoding="utf-8").splitlines()
            ]
        except (OSError, ValueError) as error:
            raise EpisodeError(
                f"{path} cannot be read ({error}); rebuild it with: trill collect --reindex "
                f"{self.root}"
            ) from error
        return sorted(lines, key=lambda line: line.meta.seed)
