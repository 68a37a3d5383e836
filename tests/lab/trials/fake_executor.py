"""An executor of threads, for tests of campaigns."""

from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from typing import Any


class FakeExecutor:
    """Runs work in threads; its workers can be lost.

    Attributes:
        size: number of workers.
        given: keys of the trials in the order in which they were started.
        ended: whether :meth:`end` was called.
        messages: returned by the next :meth:`watch`.
    """

    lost: tuple[type[Exception], ...] = (ConnectionError,)

    def __init__(
        self,
        make: Callable[[Any], Any] | None = None,
        size: int = 2,
        loses: Callable[[Any], bool] = lambda _key: False,
    ) -> None:
        """Start the threads.

        Args:
            make: invents the result of a key; None: the work is done.
            size: number of workers.
            loses: returns whether a trial that is started loses its worker.
        """
        self.size = size
        self.given: list[Any] = []
        self.ended = False
        self.messages: list[str] = []
        self._make, self._loses = make, loses
        self._pool = ThreadPoolExecutor(size)

    def submit(self, work: Callable[..., Any], /, *arguments: Any) -> "Future[Any]":
        (key,) = arguments
        self.given.append(key)
        if self._loses(key):
            future: Future[Any] = Future()
            future.set_exception(ConnectionError("gone"))
            return future
        return self._pool.submit(self._make or work, key)

    def watch(self) -> list[str]:
        messages, self.messages = self.messages, []
        return messages

    def end(self) -> None:
        self._pool.shutdown()
        self.ended = True
