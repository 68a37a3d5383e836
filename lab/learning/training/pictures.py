"""The pictures of demonstrations, decoded or rendered once and scaled to what a policy sees."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import numpy as np
from numpy.lib.format import open_memmap

from common.episodes.episode_file import open_episode
from lab.learning.training.demonstrations import Demonstration
from services.policy.configuration import Cameras, InputConfig
from services.policy.processor.pictures import Picture, scale_picture

Render = Callable[[Demonstration], Iterator[list[Picture]]]
"""Yields the pictures of a demonstration's cameras, frame by frame."""
IN_MEMORY = 4_000_000_000
"""Pictures of more bytes are kept in a file that is mapped into memory."""


def read_pictures(
    demonstrations: Sequence[Demonstration],
    inputs: InputConfig,
    path: Path,
    render: Render,
    advance: Callable[[], None] = lambda: None,
) -> Picture:
    """Return the pictures (frames, cameras, height, width, 3) of all demonstrations, in order.

    They are scaled by the function that scales live pictures, so that a network sees the same.
    Those of demonstrations without pictures are rendered; live ones are a little older than what
    is measured, and these are not.

    Args:
        demonstrations: whose pictures are read.
        inputs: of the policy.
        path: file for a large array.
        render: renders the pictures of a demonstration.
        advance: called after each demonstration.

    Raises:
        RenderingUnavailableError: some are to be rendered, and there is no off-screen OpenGL.
        ProcessorError: the pictures are smaller than what the policy sees.
        OSError: the file cannot be written.
    """
    cameras, (width, height) = inputs.cameras, inputs.picture_size
    shape = (sum(d.frames for d in demonstrations), len(cameras), height, width, 3)
    large = int(np.prod(shape)) > IN_MEMORY
    pictures: Picture = (
        open_memmap(path, mode="w+", dtype=np.uint8, shape=shape)
        if large
        else np.empty(shape, dtype=np.uint8)
    )
    at = 0
    for demonstration in demonstrations if cameras else ():
        for views in _kept(demonstration, cameras) or render(demonstration):
            pictures[at] = [scale_picture(view, inputs.picture_size) for view in views]
            at += 1
        advance()
    return pictures


def _kept(demonstration: Demonstration, cameras: Cameras) -> Iterator[list[Picture]] | None:
    """Return the pictures that a demonstration has, frame by frame; None: it has none."""
    if demonstration.meta.picture_size is None:
        return None

    def decoded() -> Iterator[list[Picture]]:
        with open_episode(demonstration.path) as episode:
            first = demonstration.first
            for frame in range(first, first + demonstration.frames):
                yield [episode.picture(camera, frame) for camera in cameras]

    return decoded()
