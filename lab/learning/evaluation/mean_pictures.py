"""The mean pictures of a data set, which a policy is shown to see what its eyes are worth."""

import hashlib
from collections.abc import Callable
from pathlib import Path

import numpy as np

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import open_episode
from common.episodes.folder import is_dataset, trial_files
from common.errors import ConfigError
from lab.errors import LabError
from lab.review.frames import write_picture
from lab.trials.folder import disk_errors
from lab.trials.operators.specs import StillPictures

EVERY = 10
"""Of each episode every so-manieth frame counts."""


def mean_pictures(
    dataset: Path, out: Path, on_file: Callable[[int, int], None] = lambda _done, _total: None
) -> StillPictures:
    """Write the mean pictures of a data set as one PNG, left beside right.

    Args:
        dataset: folder of the data set.
        out: the picture file.
        on_file: called with the number of episodes read, and of all.

    Raises:
        ConfigError: it is no data set, or has no pictures of one size.
        EpisodeError: an episode cannot be read.
        LabError: the file cannot be written.
    """
    if not is_dataset(dataset):
        raise ConfigError(
            f"--blind: expected a folder that trill collect wrote, got {dataset}; its mean "
            "pictures stand in for what the cameras see"
        )
    files = [path for path in trial_files(dataset) if path.suffix == ".h5"]
    total, count = None, 0
    for done, path in enumerate(files, start=1):
        with open_episode(path) as episode:
            if not episode.has_pictures:
                raise ConfigError(f"--blind: {path} has no pictures to take the mean of")
            for frame in range(0, episode.meta.frames, EVERY):
                both = np.concatenate([episode.picture(eye, frame) for eye in CAMERAS], axis=1)
                if total is None:
                    total = np.zeros(both.shape)
                if total.shape != both.shape:
                    raise ConfigError(f"--blind: the pictures in {dataset} have several sizes")
                total += both
                count += 1
        on_file(done, len(files))
    if total is None:
        raise ConfigError(f"--blind: {dataset} has no episodes yet")
    with disk_errors(out, LabError):
        out.parent.mkdir(parents=True, exist_ok=True)
    write_picture(out, np.rint(total / count).astype(np.uint8))
    return StillPictures(file=str(out), sha256=hashlib.sha256(out.read_bytes()).hexdigest())
