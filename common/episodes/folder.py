"""The folder of a data set: one file an episode, an index, and a description.

    dataset.json             the settings of its episodes, and the code that made them
    index.jsonl              a line a trial, by seed; can be rebuilt from the files
    episodes/000012.h5       an episode that was kept
    rejected/000013.json     a trial that was not: its metadata only

The files are the truth. A trial is done when its file is there; the index is convenience.
"""

import hashlib
from pathlib import Path

from pydantic import BaseModel, ConfigDict

from common.episodes.episode_file import EpisodeMeta, open_episode

DATASET, INDEX, EPISODES, REJECTED = "dataset.json", "index.jsonl", "episodes", "rejected"


class IndexLine(BaseModel):
    """Describes one trial in the index.

    Attributes:
        file: path relative to the data set's folder.
        kept: whether the file is an episode; otherwise it is metadata only.
        bytes: size of the file.
        sha256: digest of the file.
        meta: metadata of the trial.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    file: str
    kept: bool
    bytes: int
    sha256: str
    meta: EpisodeMeta


def index_line(name: str, content: bytes, meta: EpisodeMeta) -> IndexLine:
    """Return the index line of a trial whose file ``name`` has this content."""
    return IndexLine(
        file=name,
        kept=name.endswith(".h5"),
        bytes=len(content),
        sha256=hashlib.sha256(content).hexdigest(),
        meta=meta,
    )


def is_dataset(root: Path) -> bool:
    """Whether ``root`` is the folder of a data set."""
    return (root / DATASET).is_file()


def trial_files(root: Path) -> list[Path]:
    """Return the files of all trials: episodes first, then rejected ones, each by seed.

    Raises:
        OSError: the folder cannot be read.
    """
    found = [*(root / EPISODES).glob("*.h5"), *(root / REJECTED).glob("*.json")]
    # Seeds have six digits or more.
    return sorted(found, key=lambda path: (path.parent, len(path.stem), path.stem))


def read_meta(path: Path) -> EpisodeMeta:
    """Read the metadata of the episode in a file.

    Raises:
        EpisodeError: it cannot be reached, is no episode, one of another version, or damaged.
    """
    with open_episode(path) as episode:
        return episode.meta
