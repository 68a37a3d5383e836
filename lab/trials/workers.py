"""Processes that work for a study: fresh interpreters, a thread each, gone with their parent."""

import contextlib
import os
import signal
import threading
from collections.abc import Callable, Iterator
from concurrent.futures import Future, ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from multiprocessing import active_children, connection, get_context, parent_process
from multiprocessing.context import SpawnContext
from multiprocessing.process import BaseProcess
from time import monotonic
from typing import Any, Protocol, TypeVar

T = TypeVar("T")

ENVIRONMENT = dict.fromkeys(
    ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "LP_NUM_THREADS"), "1"
)
"""One thread a worker: the parallelism is in the trials, and sums come out the same anywhere."""

_LONGEST_LOOK = 1.0
_GRACE = 3.0
"""For a worker to end by itself [s]."""


class Stop(Protocol):
    """Tells that an end is wanted; an event of threading or multiprocessing."""

    def is_set(self) -> bool:
        """Whether it is."""
        ...


class _Sign:
    """Tells a worker that an end is wanted; that it asks tells its parent that it is alive.

    Plain shared numbers: with a lock, a worker killed while it holds it would stop all the others.
    """

    def __init__(self, end: Any, beats: Any) -> None:
        self._end, self._beats = end, beats

    def is_set(self) -> bool:
        """Whether it is."""
        self._beats.value += 1
        return bool(self._end.value)


_stop: Stop = threading.Event()


def stop_wanted() -> bool:
    """Whether what this process works at is to be given up; a worker asks often."""
    return _stop.is_set()


def the_stop() -> Stop:
    """What :func:`stop_wanted` asks."""
    return _stop


def _prepare(end: Any, beats: Any) -> None:
    """A worker begins; it never outlives its parent."""
    global _stop  # noqa: PLW0603
    _stop = _Sign(end, beats)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    # A pool's workers wait for work for ever if their parent is killed.
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def surroundings() -> Iterator[None]:
    """What new processes are to find: few threads, and Ctrl-C blocked, their parent's business."""
    before = {name: os.environ.get(name) for name in ENVIRONMENT}
    os.environ.update(ENVIRONMENT)
    # Inherited from the first moment on; a handler of theirs would come too late.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    # A thread of a library may take the signal all the same, and Python's handler then interrupts
    # this one: between a worker's start and what it is told, it would die with a traceback.
    held: list[int] = []
    usual = signal.getsignal(signal.SIGINT)
    ours = usual is not None and threading.current_thread() is threading.main_thread()
    if ours:
        signal.signal(signal.SIGINT, lambda number, _frame: held.append(number))
    try:
        yield
    finally:
        if ours:
            signal.signal(signal.SIGINT, usual)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if held:
            signal.raise_signal(held[0])


class _Worker:
    """One process, begun with its first work; a pool of its own, so that it is lost alone."""

    def __init__(self, context: SpawnContext, end: Any) -> None:
        self._beats: Any = context.Value("Q", 0, lock=False)
        self._pool = ProcessPoolExecutor(
            1, mp_context=context, initializer=_prepare, initargs=(end, self._beats)
        )
        self._futures: list[Future[Any]] = []
        self._process: BaseProcess | None = None
        self._seen, self._looked = -1, 0.0
        self.quiet = 0.0
        self.told = False

    @property
    def pending(self) -> int:
        """How much it has to do."""
        self._futures = [future for future in self._futures if not future.done()]
        return len(self._futures)

    @property
    def pid(self) -> int:
        """Of its process; 0: not begun."""
        return (self._process.pid or 0) if self._process is not None else 0

    def submit(self, work: Callable[..., T], arguments: tuple[object, ...]) -> "Future[T]":
        """Give it work; may raise BrokenProcessPool if it has just gone."""
        before = set(active_children())
        with surroundings():
            future = self._pool.submit(work, *arguments)
        if self._process is None:
            self._process = next(iter(set(active_children()) - before), None)
        self._futures.append(future)
        return future

    def look(self) -> None:
        """Count the time without a sign of life while it has work.

        In this process's own steps: if it was itself stopped or the machine slept, that is no
        silence of the worker's.
        """
        now, beats = monotonic(), self._beats.value
        if beats != self._seen or not self.pending:
            self._seen, self.quiet, self.told = beats, 0.0, False
        else:
            self.quiet += min(now - self._looked, _LONGEST_LOOK)
        self._looked = now

    def kill(self) -> None:
        """At once, stopped or not."""
        if self._process is not None:
            self._process.kill()

    def end(self) -> None:
        """Take no more."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def wait(self, seconds: float) -> bool:
        """Whether it is gone within so long."""
        return self._process is None or bool(connection.wait([self._process.sentinel], seconds))


class Workers:
    """Processes of this machine, also when it is only one: all work in the same surroundings.

    One that dies loses only what it was at; another takes its place at the next :meth:`submit`.

    Attributes:
        size: how many.
        lost: what a future raises when its worker is gone.
    """

    lost: tuple[type[Exception], ...] = (BrokenProcessPool,)

    def __init__(self, jobs: int, *, silence: float = 60.0, patience: float = 300.0) -> None:
        """Prepare; no process begins before there is work.

        Args:
            jobs: how many processes.
            silence: a worker that does not ask :func:`stop_wanted` for so long is told [s].
            patience: and for so long, killed [s].
        """
        self.size = jobs
        self._silence, self._patience = silence, patience
        # A fresh interpreter each: MuJoCo's and the solvers' threads do not survive a fork.
        self._context = get_context("spawn")
        self._end = self._context.Value("b", 0, lock=False)
        self._workers = [self._new() for _ in range(jobs)]

    def _new(self) -> _Worker:
        return _Worker(self._context, self._end)

    def submit(self, work: Callable[..., T], *arguments: object) -> "Future[T]":
        """Have a function of a module called with ``arguments``."""
        place = min(range(self.size), key=lambda i: self._workers[i].pending)
        try:
            return self._workers[place].submit(work, arguments)
        except BrokenProcessPool:
            self._replace(place)
            return self._workers[place].submit(work, arguments)

    def _replace(self, place: int) -> None:
        self._workers[place].end()
        self._workers[place] = self._new()

    def watch(self) -> list[str]:
        """Look for workers that give no sign; to be called about twice a second.

        Returns:
            what a person should hear, once for each.
        """
        news = []
        for worker in self._workers:
            worker.look()
            if worker.quiet > self._patience:
                news.append(f"worker {worker.pid}: no sign for {worker.quiet:.0f} s; killed")
                worker.kill()
                worker.quiet = 0.0
            elif worker.quiet > self._silence and not worker.told:
                worker.told = True
                news.append(
                    f"worker {worker.pid}: no sign for {worker.quiet:.0f} s. Is it stopped (go on: "
                    f"kill -CONT {worker.pid}), is memory short? It is replaced after "
                    f"{self._patience:.0f} s"
                )
        return news

    def end(self) -> None:
        """Give up what is under way: who does not end within a moment is killed."""
        self._end.value = 1
        for worker in self._workers:
            worker.end()
        until = monotonic() + _GRACE
        for worker in self._workers:
            if not worker.wait(max(0.0, until - monotonic())):
                worker.kill()
                worker.wait(_GRACE)
