"""Invented episodes, for tests of everything but the trial itself."""

import hashlib
import random
import threading
import time
from collections import Counter
from collections.abc import Container
from pathlib import Path
from typing import Any

import numpy as np

from common.episodes.columns import COLUMNS, Rows
from common.episodes.episode_file import EpisodeMeta, to_bytes
from lab.demonstrations.collect.collect import SeedKey, collect
from lab.demonstrations.collect.config import EpisodeConfig, collecting_code
from lab.demonstrations.collect.episode import EpisodeResult
from lab.demonstrations.collect.store import DatasetStore
from tests.lab.trials.fake_executor import FakeExecutor

FAILING = {1, 4, 5, 6, 11}
CONFIG = EpisodeConfig(task="door/unlock", physics_steps=5, pictures=None)
CODE = collecting_code(CONFIG.operator)


def rows(frames: int = 4, seed: int = 0) -> Rows:
    """Frames with numbers that say where they are."""
    made = Rows()
    for column in COLUMNS:
        for i in range(frames):
            width = len(column.names) or (3 if column.varies else 1)
            value = np.arange(width) + 100 * i + seed
            made.rows[column.path].append(value if column.names or column.varies else value[0])
    return made


def meta(seed: int, verdict: str = "success", frames: int = 4) -> EpisodeMeta:
    return EpisodeMeta(
        operator="synthetic",
        task="door/unlock",
        goal="Unlock the door.",
        seed=seed,
        verdict=verdict,
        reason=f"{verdict} it was",
        completion_time=5.0 + seed,
        verdict_frame=3,
        frames=frames,
        stages=(),
        gave_up="",
        picture_size=None,
        origin=CONFIG.origin(),
        versions=CODE.versions,
        source=CODE.source,
    )


def made(seed: int, verdict: str = "success") -> EpisodeResult:
    """A trial's outcome, the same for the same seed."""
    about = meta(seed, verdict)
    content = to_bytes(about, rows(seed=seed), {}) if verdict == "success" else None
    return EpisodeResult(about, content, simulated=6.0, wall=2.0)


def fake_executor(
    jobs: int = 1,
    failing: Container[int] = FAILING,
    *,
    haste: int = 0,
    together: int = 1,
    losses: dict[int, int] | None = None,
) -> FakeExecutor:
    """Return an executor that invents results after random times.

    Args:
        jobs: number of workers.
        failing: seeds of the trials that are no success.
        haste: seed of the times.
        together: the first so many trials only end once all of them have begun.
        losses: how many workers the trials with these seeds lose.
    """
    pauses, barrier = random.Random(haste), threading.Barrier(together)
    left = Counter(losses or {})

    def make(key: SeedKey) -> EpisodeResult:
        if key.seed < together:
            barrier.wait(timeout=20.0)
        time.sleep(pauses.uniform(0.0, 0.01))
        return made(key.seed, "failure" if key.seed in failing else "success")

    def loses(key: SeedKey) -> bool:
        left[key.seed] -= 1
        return left[key.seed] >= 0

    return FakeExecutor(make, jobs, loses)


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of every file but the lock."""
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def gather(
    root: Path,
    wanted: int,
    executor: FakeExecutor | None = None,
    config: EpisodeConfig = CONFIG,
    **options: Any,
) -> FakeExecutor:
    """Collect invented episodes; returns the executor."""
    executor = executor or fake_executor()
    options = {"max_trials": 99} | options
    collect(config, DatasetStore(root), lambda: executor, wanted=wanted, **options)
    return executor


def seeds(executor: FakeExecutor) -> list[int]:
    """Seeds of the trials that were started, in order."""
    return [key.seed for key in executor.given]
