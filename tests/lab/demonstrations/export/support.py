"""Data sets of invented episodes, small and quickly made."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from common.episodes.columns import CAMERAS, COLUMNS, Rows
from common.episodes.episode_file import EpisodeMeta, Image, Operator, to_bytes
from lab.demonstrations.collect.config import EpisodeConfig, PictureConfig
from lab.demonstrations.collect.store import DatasetStore
from lab.trials.provenance import CodeVersion
from services.sim.tasks import find_task

SIZE = (48, 32)
FRAMES, VERDICT = 13, 10
CODE = CodeVersion(source="0123", versions={"python": "3"})


def picture(seed: int, camera: str, frame: int, size: tuple[int, int] = SIZE) -> Image:
    """Soft colours that tell seeds, cameras and frames apart."""
    width, height = size
    x, y = np.meshgrid(np.linspace(0, 1, width), np.linspace(0, 1, height))
    phase = 0.4 * frame + seed + 2.0 * (camera == "right")
    waves = [np.sin(3 * x + phase), np.cos(2 * y + phase), np.sin(x + y - phase)]
    return np.asarray(np.stack(waves, axis=-1) * 100 + 128, dtype=np.uint8)


def rows(seed: int, frames: int = FRAMES) -> Rows:
    rng, made = np.random.default_rng(seed), Rows()
    for frame in range(frames):
        for column in COLUMNS:
            width = len(column.names) or (3 if column.varies else 1)
            value: Any = rng.normal(size=width)
            if column.path.startswith("time/"):
                value = np.array([1_000_000_000 + 50_000_000 * frame])
            elif column.dtype == "<i8":
                value = rng.integers(0, 7, size=1)
            elif column.dtype == "|b1":
                value = np.zeros(1, dtype=np.bool_)
            made.rows[column.path].append(value if column.names or column.varies else value[0])
    return made


def make(
    root: Path,
    verdicts: tuple[str, ...] = ("success", "success", "success"),
    *,
    task: str = "door/unlock",
    size: tuple[int, int] | None = SIZE,
    rows_of: dict[int, Rows] | None = None,
    physics_steps: int = 1,
    operator: Operator = "synthetic",
) -> Path:
    """A data set: the trial with seed i ends with ``verdicts[i]``."""
    pictures_config = PictureConfig(width=size[0], height=size[1], quality=95) if size else None
    config = EpisodeConfig(
        task=task, pictures=pictures_config, keep_failures=True, physics_steps=physics_steps
    )
    store = DatasetStore(root)
    with store.writing(config, CODE):
        for seed, verdict in enumerate(verdicts):
            given = (rows_of or {}).get(seed) or rows(seed)
            pictures = {
                camera: [_jpeg(picture(seed, camera, i, size)) for i in range(len(given))]
                for camera in (CAMERAS if size else ())
                if size
            }
            about = EpisodeMeta(
                operator=operator,
                task=task,
                goal=find_task(task).goal,
                seed=seed,
                verdict=verdict,
                reason=f"{verdict} it was",
                completion_time=0.5,
                verdict_frame=VERDICT,
                frames=len(given),
                stages=(),
                gave_up="",
                frame_tolerance=0.001 * physics_steps,
                picture_size=size,
                origin=config.origin(),
                versions=CODE.versions,
                source=CODE.source,
            )
            store.add(about, to_bytes(about, given, pictures))
    return root


def _jpeg(image: Image) -> bytes:
    bgr = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
    _, file = cv2.imencode(".jpg", bgr, [cv2.IMWRITE_JPEG_QUALITY, 95])
    return file.tobytes()
