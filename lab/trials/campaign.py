"""Runs many trials at a time, in order, and replaces workers that are lost.

Collecting, task tables and studies share it. It depends neither on what a trial is nor on where
results are kept: a key identifies a trial, a function turns it into a result, and a callback gets
both.
"""

from collections import Counter
from collections.abc import Callable, Iterable
from concurrent.futures import FIRST_COMPLETED, Future, wait
from typing import Final, Protocol, TypeVar

from common.errors import TrillError
from lab.errors import LabError

K = TypeVar("K")
R = TypeVar("R")
T = TypeVar("T")

_WAIT: Final = 0.5
"""The workers are looked at, and progress is reported, this often at least [s]."""
_TRIES: Final = 3
"""A trial that has cost so many workers is not started again."""


class Executor(Protocol):
    """Runs functions in several worker processes.

    Attributes:
        size: number of workers.
        lost: exceptions that a future raises when its worker is gone.
    """

    size: int
    lost: tuple[type[Exception], ...]

    def submit(self, work: Callable[..., T], /, *arguments: object) -> "Future[T]":
        """Start ``work(*arguments)``; both must be importable in, or picklable to, the worker."""
        ...

    def watch(self) -> list[str]:
        """Check the workers, about twice a second; returns messages for the user."""
        ...

    def end(self) -> None:
        """Cancel all work and end the workers."""
        ...


def run_campaign(
    keys: Iterable[K],
    work: Callable[[K], R],
    executor: Executor,
    *,
    on_result: Callable[[K, R], None],
    on_message: Callable[[str], None] = lambda _text: None,
    on_wait: Callable[[], None] = lambda: None,
    may_start: Callable[[K, int], bool] = lambda _key, _under_way: True,
) -> None:
    """Run ``work`` for every key; at most as many at a time as there are workers.

    Keys are started in order. The campaign ends when all are done, or when ``may_start`` refuses
    the next key while nothing is under way. The executor is ended in any case.

    Args:
        keys: one for each trial; ``str(key)`` names the trial in messages.
        work: runs a trial in a worker.
        executor: the workers.
        on_result: called in this process with each key and its result.
        on_message: called with what the user should know of the workers.
        on_wait: called about twice a second while no result arrives.
        may_start: whether a key may be started while so many others are under way.

    Raises:
        LabError: a trial has cost several workers.
        TrillError: ``work`` or a callback raised it.
    """
    waiting = enumerate(keys)
    upcoming = next(waiting, None)
    under_way: dict[Future[R], tuple[int, K]] = {}
    losses: Counter[int] = Counter()
    try:
        while True:
            while (
                upcoming is not None
                and len(under_way) < executor.size
                and may_start(upcoming[1], len(under_way))
            ):
                under_way[executor.submit(work, upcoming[1])] = upcoming
                upcoming = next(waiting, None)
            if not under_way:
                return
            done, _ = wait(under_way, timeout=_WAIT, return_when=FIRST_COMPLETED)
            # In the order of the keys, so that what is kept does not depend on who was faster.
            for future in sorted(done, key=lambda future: under_way[future][0]):
                number, key = under_way.pop(future)
                try:
                    result = future.result()
                except TrillError:
                    raise
                except executor.lost as error:
                    losses[number] += 1
                    _check_losses(key, losses[number], error)
                    on_message(
                        f"the worker of {key} died (was it killed? is memory short?); another "
                        "runs the trial again"
                    )
                    under_way[executor.submit(work, key)] = (number, key)
                    continue
                on_result(key, result)
            for text in executor.watch():
                on_message(text)
            if not done:
                on_wait()
    finally:
        executor.end()


def _check_losses(key: object, losses: int, error: Exception) -> None:
    if losses >= _TRIES:
        raise LabError(
            f"{key} has cost {losses} workers ({error}); what is done is kept: give the same "
            "command again, with fewer --jobs if memory was short"
        ) from error
