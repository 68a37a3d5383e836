"""Summarises a data set as a table, and draws an episode as a picture."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Group, RenderableType
from rich.table import Table

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import Episode, Image, open_episode
from common.episodes.errors import EpisodeError
from common.episodes.folder import IndexLine
from lab.demonstrations.collect.config import EpisodeConfig
from lab.demonstrations.collect.progress import failures
from lab.demonstrations.collect.space import size
from lab.demonstrations.collect.store import DatasetStore
from lab.review.frames import letterbox, with_caption, write_picture
from lab.trials.links import links_text
from lab.trials.spec import format_spread
from services.sim.rendering.render import contact_sheet

SHOWN = 8
"""Number of moments on the sheet of an episode."""
_WIDTH = 400
"""Width of a picture on the sheet [pixels]."""


def table(lines: list[IndexLine]) -> RenderableType:
    """Return a row for each task, operators and settings, and the reasons of failures."""
    rows = Table(title="data set")
    for title in ("task", "trials", "kept", "success", "time of successes [s]", "frames", "size"):
        rows.add_column(title, justify="left" if title == "task" else "right")
    for task in dict.fromkeys(line.meta.task for line in lines):
        mine = [line for line in lines if line.meta.task == task]
        kept = [line for line in mine if line.kept]
        times = [line.meta.completion_time for line in mine if line.meta.success]
        rows.add_row(
            task,
            str(len(mine)),
            str(len(kept)),
            f"{len(times)} ({100 * len(times) / len(mine):.0f} %)",
            format_spread(times),
            str(sum(line.meta.frames for line in kept)),
            size(sum(line.bytes for line in kept)),
        )
    conditions = {_conditions(line) for line in lines}
    return Group(rows, *sorted(conditions), *failures(lines))


def _conditions(line: IndexLine) -> str:
    """Format who operated the robot, and under which settings."""
    pictures = line.meta.picture_size
    text = f"pictures: {pictures[0]}x{pictures[1]}" if pictures else "pictures: none"
    if line.meta.recording:
        links: Any = line.meta.recording.get("links", {})
        return f"operator: {line.meta.operator}, recorded; links: {links_text(links)}; {text}"
    config = EpisodeConfig.of(line.meta)
    return (
        f"operator: {config.operator}; links: {links_text(config.links)}; torques: "
        f"{config.torque_mode}; {text}"
    )


def sheet(episode: Episode, shown: int = SHOWN) -> Image:
    """Draw both cameras at evenly spaced moments, captioned with time, state and action.

    Raises:
        EpisodeError: the episode has no pictures.
    """
    frames = np.linspace(0, episode.meta.frames - 1, min(shown, episode.meta.frames)).round()
    tiles = []
    for frame in frames.astype(int).tolist():
        captions = (_observation_text(episode, frame), _action_text(episode, frame))
        for camera, caption in zip(CAMERAS, captions, strict=True):
            picture = episode.picture(camera, frame)
            height = round(picture.shape[0] * _WIDTH / picture.shape[1])
            tiles.append(with_caption(letterbox(picture, _WIDTH, height), caption))
    return contact_sheet(tiles, columns=4)


def _observation_text(episode: Episode, frame: int) -> str:
    one = slice(frame, frame + 1)
    begin = int(episode.array("time/robot_ns", slice(0, 1))[0])
    time = (int(episode.array("time/robot_ns", one)[0]) - begin) * 1e-9
    state = int(episode.array("observation/control_state", one)[0])
    return f"left camera  frame {frame}  {time:.2f} s  state {state}"


def _action_text(episode: Episode, frame: int) -> str:
    one = slice(frame, frame + 1)
    hands = episode.array("action/hands", one)[0]
    left, right = (" ".join(f"{v:+.2f}" for v in hands[i : i + 3]) for i in (0, 7))
    grasp = episode.array("action/grasp", one)[0]
    gait = int(episode.array("action/locomotion", one)[0])
    return f"L {left}  R {right}  grip {grasp[0]:.1f} {grasp[1]:.1f}  gait {gait}"


def write_sheet(root: Path, seed: int | None, path: Path) -> int:
    """Write the sheet of the episode with ``seed`` (None: the first); returns its seed.

    Raises:
        EpisodeError: there is no such episode, or it has no pictures, or cannot be read.
        LabError: the file cannot be written.
    """
    kept = {line.meta.seed: line for line in DatasetStore(root).index() if line.kept}
    chosen = seed if seed is not None else min(kept, default=-1)
    if chosen not in kept:
        raise EpisodeError(
            f"no episode with seed {chosen} in {root}: expected one of {list(kept)[:20]}"
            if kept
            else f"{root} has no episodes yet"
        )
    file = root / kept[chosen].file
    with open_episode(file) as episode:
        picture = sheet(episode)
    write_picture(path, picture)
    return chosen
