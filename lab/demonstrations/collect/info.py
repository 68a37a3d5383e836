"""What is in a data set, as a table, and what an episode looks like, as a picture."""

import statistics
from pathlib import Path

import cv2
import numpy as np
from rich.console import Console, Group, RenderableType
from rich.table import Table

from common.episodes.columns import CAMERAS
from common.episodes.episode_file import Episode, Image, open_episode
from common.episodes.errors import EpisodeError
from common.episodes.folder import DAMAGED, IndexLine
from lab.demonstrations.collect.config import EpisodeConfig
from lab.demonstrations.collect.progress import failures
from lab.demonstrations.collect.store import Store
from lab.review.frames import write_picture
from services.sim.rendering.render import contact_sheet

SHOWN = 8
"""Moments of an episode on its sheet."""
_CAPTION = 20
_WIDTH = 400


def table(lines: list[IndexLine]) -> RenderableType:
    """A row a task, what was no success and why, and who acted."""
    rows = Table(title="data set")
    for title in ("task", "trials", "kept", "success", "time of successes [s]", "frames", "size"):
        rows.add_column(title, justify="left" if title == "task" else "right")
    for task in dict.fromkeys(line.meta.task for line in lines):
        rows.add_row(task, *_cells([line for line in lines if line.meta.task == task]))
    bad = [line for line in lines if not line.meta.success]
    conditions = {_conditions(line) for line in lines}
    return Group(rows, *sorted(conditions), *failures(bad))


def _conditions(line: IndexLine) -> str:
    """Who operated the robot, and under which settings."""
    size, origin = line.meta.picture_size, line.meta.origin
    pictures = f"{size[0]}x{size[1]}" if size else "none"
    if line.meta.operator != "synthetic":
        return f"operator: {line.meta.operator}; pictures: {pictures}"
    config = EpisodeConfig.checked(origin)
    links = ", ".join(f"{name}={spec}" for name, spec in config.links.items()) or "none"
    return (
        f"operator: synthetic, {config.traits.name}; links: {links}; torques: "
        f"{config.torque_mode}; pictures: {pictures}"
    )


def _cells(lines: list[IndexLine]) -> list[str]:
    times = [line.meta.completion_time for line in lines if line.meta.success]
    kept = [line for line in lines if line.kept]
    spread = (
        f"{statistics.median(times):.1f} ({min(times):.1f} to {max(times):.1f})" if times else ""
    )
    return [
        str(len(lines)),
        str(len(kept)),
        f"{len(times)} ({100 * len(times) / len(lines):.0f} %)",
        spread,
        str(sum(line.meta.frames for line in kept)),
        f"{sum(line.bytes for line in kept) * 1e-6:.1f} MB",
    ]


def show(root: Path, console: Console) -> None:
    """Print the table of a data set.

    Raises:
        EpisodeError: there is no index.
    """
    console.print(table(Store(root).index()), markup=False)


def sheet(episode: Episode, shown: int = SHOWN) -> Image:
    """Both eyes at evenly spaced moments, with time, state, gait, hands and grippers in words.

    Raises:
        EpisodeError: the episode has no pictures.
    """
    frames = np.linspace(0, episode.meta.frames - 1, min(shown, episode.meta.frames)).round()
    tiles = []
    for frame in frames.astype(int).tolist():
        captions = (_seen(episode, frame), _done(episode, frame))
        for camera, caption in zip(CAMERAS, captions, strict=True):
            tiles.append(_captioned(episode.picture(camera, frame), caption))
    return contact_sheet(tiles, columns=4)


def _seen(episode: Episode, frame: int) -> str:
    one = slice(frame, frame + 1)
    begin = int(episode.array("time/robot_ns", slice(0, 1))[0])
    time = (int(episode.array("time/robot_ns", one)[0]) - begin) * 1e-9
    state = int(episode.array("observation/control_state", one)[0])
    return f"left eye  frame {frame}  {time:.2f} s  state {state}"


def _done(episode: Episode, frame: int) -> str:
    one = slice(frame, frame + 1)
    hands = episode.array("action/hands", one)[0]
    left, right = (" ".join(f"{v:+.2f}" for v in hands[i : i + 3]) for i in (0, 7))
    grasp = episode.array("action/grasp", one)[0]
    gait = int(episode.array("action/locomotion", one)[0])
    return f"L {left}  R {right}  grip {grasp[0]:.1f} {grasp[1]:.1f}  gait {gait}"


def _captioned(picture: Image, text: str) -> Image:
    height = round(picture.shape[0] * _WIDTH / picture.shape[1])
    enlarged = cv2.resize(picture, (_WIDTH, height), interpolation=cv2.INTER_NEAREST)
    strip = np.full((_CAPTION, _WIDTH, 3), 255, dtype=np.uint8)
    font = cv2.FONT_HERSHEY_SIMPLEX
    cv2.putText(strip, text, (4, 14), font, 0.38, (0, 0, 0), 1, cv2.LINE_AA)
    return np.concatenate((np.asarray(enlarged, dtype=np.uint8), strip))


def write_sheet(root: Path, seed: int | None, path: Path) -> int:
    """Write the sheet of the episode with ``seed`` (None: the first); returns its seed.

    Raises:
        EpisodeError: there is no such episode, or it has no pictures, or is damaged.
        LabError: the file cannot be written.
    """
    kept = {line.meta.seed: line for line in Store(root).index() if line.kept}
    chosen = seed if seed is not None else min(kept, default=-1)
    if chosen not in kept:
        raise EpisodeError(
            f"no episode with seed {chosen} in {root}: expected one of {list(kept)[:20]}"
            if kept
            else f"{root} has no episodes yet"
        )
    file = root / kept[chosen].file
    try:
        with open_episode(file) as episode:
            picture = sheet(episode)
    except (*DAMAGED, cv2.error) as error:
        raise EpisodeError(
            f"cannot read {file}, it is damaged: {str(error).partition(chr(10))[0]}; trill collect "
            "--check tells more"
        ) from error
    write_picture(path, picture)
    return chosen
