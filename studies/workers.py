"""Processes that work for a study: fresh interpreters, a thread each, gone with their parent."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import connection, get_context, parent_process
from typing import Protocol, TypeVar

T = TypeVar("T")

ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS"), "1"
)
"""One thread a worker: the parallelism is in the trials, and sums come out the same anywhere."""


class Stop(Protocol):
    """Tells that an end is wanted; an event of threading or multiprocessing."""

    def is_set(self) -> bool:
        """Whether it is."""
        ...


_stop: Stop = threading.Event()


def stop_wanted() -> bool:
    """Whether what this process works at is to be given up."""
    return _stop.is_set()


def the_stop() -> Stop:
    """What :func:`stop_wanted` asks."""
    return _stop


def _prepare(stop: Stop) -> None:
    """A worker begins; it never outlives its parent."""
    global _stop  # noqa: PLW0603
    _stop = stop
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    # A pool's workers wait for work for ever if their parent is killed.
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def _surroundings() -> Iterator[None]:
    """What new processes are to find: few threads, and Ctrl-C blocked, their parent's business."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    # Inherited from the first moment on; a handler of theirs would come too late.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


class Workers:
    """Processes of this machine, also when it is only one: all work in the same surroundings.

    Attributes:
        size: how many.
        lost: what a future raises when its worker is gone.
    """

    lost: tuple[type[Exception], ...] = (BrokenProcessPool,)

    def __init__(self, jobs: int) -> None:
        self.size = jobs
        # A fresh interpreter each: MuJoCo's and the solvers' threads do not survive a fork.
        context = get_context("spawn")
        self._stop = context.Event()
        self._pool = ProcessPoolExecutor(
            jobs, mp_context=context, initializer=_prepare, initargs=(self._stop,)
        )

    def submit(self, work: Callable[..., T], *arguments: object) -> "Future[T]":
        """Have a function of a module called with ``arguments``."""
        with _surroundings():
            return self._pool.submit(work, *arguments)

    def end(self) -> None:
        """Give up what is under way: it ends when it next asks :func:`stop_wanted`."""
        self._stop.set()
        self._pool.shutdown(wait=True, cancel_futures=True)
