"""Worker processes of this machine: fresh interpreters, tied to their parent."""

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

from common.program import ENDING

T = TypeVar("T")

WORKER_ENVIRONMENT = {
    **dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1"),
    # Not even one beside the thread that draws, which would only wait for it.
    "LP_NUM_THREADS": "0",
}
"""One thread for each worker: trials run in parallel, and sums come out the same on like
processors, however many there are."""

_LONGEST_INTERVAL = 1.0
"""Between two checks of a worker at most this much time counts as its silence [s]."""
_GRACE = 3.0
"""A worker has this much time to end by itself [s]."""


class Stop(Protocol):
    """Requests that work ends; an event of threading or multiprocessing has this interface."""

    def is_set(self) -> bool:
        """Whether the end is requested."""
        ...


class _SharedStop:
    """Requests in a worker that it ends; each question counts as a sign of life for the parent.

    It uses plain shared numbers: if it had a lock, a worker killed while holding it would stop all
    the others.
    """

    def __init__(self, end: Any, beats: Any) -> None:
        self._end, self._beats = end, beats

    def is_set(self) -> bool:
        """Whether the end is requested."""
        self._beats.value += 1
        return bool(self._end.value)


_stop: Stop = threading.Event()


def stop_request() -> Stop:
    """Return the request that this process gives its work up; work asks it often."""
    return _stop


def _prepare(end: Any, beats: Any) -> None:
    """Set a new worker up; it never outlives its parent."""
    global _stop  # noqa: PLW0603
    _stop = _SharedStop(end, beats)
    threading.Thread(target=_follow_parent, daemon=True).start()


def _follow_parent() -> None:
    # A pool's workers would wait for work for ever if their parent is killed.
    parent = parent_process()
    if parent is not None:
        connection.wait([parent.sentinel])
        os._exit(1)


@contextlib.contextmanager
def worker_environment() -> Iterator[None]:
    """Spawn environment: one BLAS thread for each worker; the parent alone is asked to end."""
    before = {name: os.environ.get(name) for name in WORKER_ENVIRONMENT}
    os.environ.update(WORKER_ENVIRONMENT)
    # Inherited from the first moment on; a handler of theirs would come too late.
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, ENDING)
    # A thread of a library may take the signal all the same, and Python's handler then interrupts
    # this one: between its start and its first work, a worker would die with a traceback.
    held: list[int] = []
    usual: dict[signal.Signals, Any] = {}
    if threading.current_thread() is threading.main_thread():
        usual = {number: signal.getsignal(number) for number in ENDING}
    for number, handler in usual.items():
        if handler not in {None, signal.SIG_IGN}:
            signal.signal(number, lambda number, _frame: held.append(number))
    try:
        yield
    finally:
        for number, handler in usual.items():
            if handler is not None:
                signal.signal(number, handler)
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value
        if held:
            signal.raise_signal(held[0])


class _Worker:
    """One process, started with its first work, in a pool of its own so that it is lost alone."""

    def __init__(self, context: SpawnContext, end: Any) -> None:
        self._beats: Any = context.Value("Q", 0, lock=False)
        self._pool = ProcessPoolExecutor(
            1, mp_context=context, initializer=_prepare, initargs=(end, self._beats)
        )
        self._futures: list[Future[Any]] = []
        self._process: BaseProcess | None = None
        self._seen, self._looked = -1, 0.0
        self.silence = 0.0
        self.reported = False

    @property
    def pending(self) -> int:
        """Number of functions that it has not finished."""
        self._futures = [future for future in self._futures if not future.done()]
        return len(self._futures)

    @property
    def pid(self) -> int:
        """Its process id; 0: not started."""
        return (self._process.pid or 0) if self._process is not None else 0

    def submit(self, work: Callable[..., T], arguments: tuple[object, ...]) -> "Future[T]":
        """Start work in it; raises BrokenProcessPool if it has just died."""
        before = set(active_children())
        with worker_environment():
            future = self._pool.submit(work, *arguments)
        if self._process is None:
            self._process = next(iter(set(active_children()) - before), None)
        self._futures.append(future)
        return future

    def look(self) -> None:
        """Measure how long it has shown no sign of life while it has work.

        Only short intervals count: if this process was itself stopped, or the machine slept, the
        worker is not to blame.
        """
        now, beats = monotonic(), self._beats.value
        if beats != self._seen or not self.pending:
            self._seen, self.silence, self.reported = beats, 0.0, False
        else:
            self.silence += min(now - self._looked, _LONGEST_INTERVAL)
        self._looked = now

    def kill(self) -> None:
        """Kill it, also if it is stopped."""
        if self._process is not None:
            self._process.kill()

    def end(self) -> None:
        """Accept no more work."""
        self._pool.shutdown(wait=False, cancel_futures=True)

    def wait(self, seconds: float) -> bool:
        """Wait for its end; returns whether it came within ``seconds``."""
        return self._process is None or bool(connection.wait([self._process.sentinel], seconds))


class LocalExecutor:
    """Runs functions in processes of this machine, all in the same environment.

    A worker that dies loses only its own work; another takes its place at the next :meth:`submit`.

    Attributes:
        size: number of workers.
        lost: exceptions that a future raises when its worker is gone.
    """

    lost: tuple[type[Exception], ...] = (BrokenProcessPool,)

    def __init__(self, jobs: int, *, silence: float = 60.0, patience: float = 300.0) -> None:
        """Prepare the workers; no process starts before there is work.

        Args:
            jobs: number of processes.
            silence: a worker that does not ask :func:`stop_request` for so long is reported [s].
            patience: a worker that does not ask for so long is killed [s].
        """
        self.size = jobs
        self._silence, self._patience = silence, patience
        # A fresh interpreter each: MuJoCo's and the solvers' threads do not survive a fork.
        self._context = get_context("spawn")
        self._end = self._context.Value("b", 0, lock=False)
        self._workers = [self._new() for _ in range(jobs)]

    @property
    def pids(self) -> list[int]:
        """Process ids of the workers that have been started."""
        return [worker.pid for worker in self._workers if worker.pid]

    def _new(self) -> _Worker:
        return _Worker(self._context, self._end)

    def submit(self, work: Callable[..., T], /, *arguments: object) -> "Future[T]":
        """Start ``work(*arguments)`` in the worker that has the least to do."""
        index = min(range(self.size), key=lambda i: self._workers[i].pending)
        try:
            return self._workers[index].submit(work, arguments)
        except BrokenProcessPool:
            self._replace(index)
            return self._workers[index].submit(work, arguments)

    def _replace(self, index: int) -> None:
        self._workers[index].end()
        self._workers[index] = self._new()

    def watch(self) -> list[str]:
        """Check for workers that show no sign of life; to be called about twice a second.

        Returns:
            messages for the user, each once.
        """
        messages = []
        for worker in self._workers:
            worker.look()
            if worker.silence > self._patience:
                messages.append(
                    f"worker {worker.pid} was silent for {worker.silence:.0f} s and was killed"
                )
                worker.kill()
                worker.silence = 0.0
            elif worker.silence > self._silence and not worker.reported:
                worker.reported = True
                messages.append(
                    f"worker {worker.pid} has been silent for {worker.silence:.0f} s. Is it "
                    f"stopped (to go on: kill -CONT {worker.pid})? Is memory short? It is "
                    f"replaced after {self._patience:.0f} s"
                )
        return messages

    def end(self) -> None:
        """Cancel all work; a worker that does not end within a moment is killed.

        One without work is killed at once: it has nothing left to do, and an interpreter with
        simulation and renderer takes longer to clear up than to be gone.
        """
        self._end.value = 1
        for worker in self._workers:
            idle = not worker.pending
            worker.end()
            if idle:
                worker.kill()
        until = monotonic() + _GRACE
        for worker in self._workers:
            if not worker.wait(max(0.0, until - monotonic())):
                worker.kill()
                worker.wait(_GRACE)
