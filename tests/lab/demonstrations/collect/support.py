"""Invented episodes, for tests of everything but the trial itself."""

import hashlib
import random
import threading
import time
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np

from common.episodes.columns import COLUMNS, Rows
from common.episodes.episode_file import EpisodeMeta, to_bytes
from lab.demonstrations.collect.collect import collect
from lab.demonstrations.collect.config import EpisodeConfig, collecting_code
from lab.demonstrations.collect.episode import EpisodeResult
from lab.demonstrations.collect.store import Store

FAILING = {1, 4, 5, 6, 11}
CONFIG = EpisodeConfig(task="door/unlock", physics_steps=5, pictures=None)
CODE = collecting_code()


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


class FakeExecutor:
    """Threads that take random times; which seeds succeed is settled beforehand.

    The first ``together`` trials only end once all of them have begun.
    """

    lost: tuple[type[Exception], ...] = ()

    def __init__(self, jobs: int, failing: set[int], haste: int = 0, together: int = 1) -> None:
        self.size = jobs
        self.given: list[int] = []
        self.ended = False
        self._failing, self._haste = failing, random.Random(haste)
        self._together, self._barrier = together, threading.Barrier(together)
        self._pool = ThreadPoolExecutor(jobs)

    def submit(self, work: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        (key,) = arguments
        seed = key.seed
        self.given.append(seed)
        first = len(self.given) <= self._together
        return self._pool.submit(self._work, seed, first, self._haste.uniform(0.0, 0.01))

    def _work(self, seed: int, first: bool, pause: float) -> EpisodeResult:
        if first:
            self._barrier.wait(timeout=20.0)
        time.sleep(pause)
        return made(seed, "failure" if seed in self._failing else "success")

    def watch(self) -> list[str]:
        return []

    def end(self) -> None:
        self._pool.shutdown()
        self.ended = True


def digests(root: Path) -> dict[str, str]:
    """SHA-256 of every file but the lock."""
    return {
        str(path.relative_to(root)): hashlib.sha256(path.read_bytes()).hexdigest()
        for path in sorted(root.rglob("*"))
        if path.is_file() and path.name != ".lock"
    }


def gather(root: Path, wanted: int, jobs: int = 1, haste: int = 0, most: int = 99) -> FakeExecutor:
    """Collect with an invented executor, in which the seeds ``FAILING`` are no success."""
    executor = FakeExecutor(jobs, FAILING, haste)
    collect(CONFIG, Store(root), lambda: executor, wanted=wanted, max_trials=most)
    return executor
