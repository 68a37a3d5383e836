"""The pictures of demonstrations, decoded once and scaled to what a policy sees."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.format import open_memmap

from common.episodes.episode_file import open_episode
from lab.errors import TrainingError
from lab.learning.training.demonstrations import Demonstration
from services.policy.configuration import InputConfig
from services.policy.processor.pictures import Picture, scale_picture

IN_MEMORY = 4_000_000_000
"""Pictures of more bytes are kept in a file that is mapped into memory."""


def read_pictures(
    demonstrations: Sequence[Demonstration],
    inputs: InputConfig,
    folder: Path,
    advance: Callable[[], None] = lambda: None,
) -> Picture:
    """Return the pictures (frames, cameras, height, width, 3) of all demonstrations, in order.

    They are scaled by the function that scales live pictures, so that a network sees the same.

    Args:
        demonstrations: whose pictures are read.
        inputs: of the policy.
        folder: where a large array is kept, as ``pictures.npy``.
        advance: called after each demonstration.

    Raises:
        TrainingError: a demonstration has no pictures.
        ProcessorError: the pictures are smaller than what the policy sees.
        OSError: the file cannot be written.
    """
    cameras, (width, height) = inputs.cameras, inputs.picture_size
    shape = (sum(d.frames for d in demonstrations), len(cameras), height, width, 3)
    large = int(np.prod(shape)) > IN_MEMORY
    pictures: Picture = (
        open_memmap(folder / "pictures.npy", mode="w+", dtype=np.uint8, shape=shape)
        if large
        else np.empty(shape, dtype=np.uint8)
    )
    at = 0
    for demonstration in demonstrations if cameras else ():
        with open_episode(demonstration.path) as episode:
            if not episode.has_pictures:
                raise TrainingError(
                    f"{demonstration.path} has no pictures, which the policy sees; collect without "
                    "--no-images, or train with --inputs scene or --inputs blind"
                )
            first = demonstration.first
            for frame in range(first, first + demonstration.frames):
                for i, camera in enumerate(cameras):
                    whole = episode.picture(camera, frame)
                    pictures[at, i] = scale_picture(whole, inputs.picture_size)
                at += 1
        advance()
    return pictures
