"""Who makes the episodes: processes of this machine, or a Ray cluster.

Both are given one seed at a time and answer with a future, so that the same loop drives both.
"""

import socket
from concurrent.futures import Future
from typing import Any, Protocol

from common.episodes.errors import EpisodeError
from lab.demonstrations.collect.episode import EpisodeResult, make_episode
from lab.demonstrations.collect.recipe import EpisodeConfig
from lab.trials.workers import ENVIRONMENT, Workers, the_stop

_PATIENCE = 10.0
"""With a cluster that does not answer [s]."""


class Executor(Protocol):
    """Makes episodes at the same time.

    Attributes:
        size: how many.
        lost: what a future raises when its worker is gone.
    """

    size: int
    lost: tuple[type[Exception], ...]

    def submit(self, seed: int) -> "Future[EpisodeResult]":
        """Begin one."""
        ...

    def watch(self) -> list[str]:
        """Look after the workers, about twice a second; returns what a person should hear."""
        ...

    def end(self) -> None:
        """Give up what is under way."""
        ...


def _work(recipe: EpisodeConfig, seed: int) -> EpisodeResult:
    return make_episode(recipe, seed, the_stop())


class LocalExecutor:
    """Processes of this machine."""

    lost = Workers.lost

    def __init__(self, recipe: EpisodeConfig, jobs: int) -> None:
        self.size = jobs
        self._recipe = recipe
        self._workers = Workers(jobs)

    def submit(self, seed: int) -> "Future[EpisodeResult]":
        """Begin one."""
        return self._workers.submit(_work, self._recipe, seed)

    def watch(self) -> list[str]:
        """Workers that give no sign of life are told, later replaced."""
        return self._workers.watch()

    def end(self) -> None:
        """Give up what is under way; it takes a few seconds at most."""
        self._workers.end()


def _reach(address: str) -> None:
    """Ray itself would try for many minutes.

    Raises:
        EpisodeError: nobody answers at ``address``.
    """
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon:
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_PATIENCE).close()
    except (OSError, ValueError) as error:
        raise EpisodeError(
            f"no Ray cluster at {address!r}: {error}; expected auto, HOST:PORT as `ray start "
            "--head` prints it, or ray://HOST:PORT"
        ) from error


class RayExecutor:
    """Workers of a Ray cluster; every node needs this package with its extra ``collect``.

    Episodes come back through Ray, so the nodes need no common file system. An episode whose node
    is lost is made again elsewhere.
    """

    def __init__(self, recipe: EpisodeConfig, address: str, jobs: int | None) -> None:
        """Join the cluster.

        Args:
            recipe: what to make.
            address: ``auto``, ``HOST:PORT``, ``ray://HOST:PORT``, or ``local`` for one of its own.
            jobs: episodes at a time; None: as many as the cluster has processors.

        Raises:
            EpisodeError: Ray is not installed, or there is no cluster there.
        """
        try:
            import ray
        except ImportError as error:
            raise EpisodeError(
                "--ray needs the package ray: pip install 'trill[ray]' (here and on every node)"
            ) from error
        self._ray: Any = ray
        _reach(address)
        # Variables of the process that starts a worker would not reach another machine.
        surroundings = {"env_vars": ENVIRONMENT}
        try:
            ray.init(address=address, log_to_driver=False, runtime_env=surroundings)
        except (ConnectionError, ValueError, RuntimeError) as error:
            raise EpisodeError(f"no Ray cluster at {address!r}: {error}") from error
        # Not RayTaskError: a fault of the program's own would only come again.
        failures = ray.exceptions
        self.lost: tuple[type[Exception], ...] = (
            failures.WorkerCrashedError,
            failures.NodeDiedError,
            failures.ObjectLostError,
            failures.OutOfMemoryError,
            failures.RaySystemError,
        )
        self.size = jobs or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._make: Any = ray.remote(num_cpus=1, max_retries=3)(make_episode)
        self._recipe: Any = ray.put(recipe)
        self._references: dict[int, Any] = {}
        self._nodes = sum(bool(node["Alive"]) for node in ray.nodes())

    def submit(self, seed: int) -> "Future[EpisodeResult]":
        """Begin one."""
        reference = self._make.remote(self._recipe, seed)
        self._references[seed] = reference
        future: Future[EpisodeResult] = reference.future()
        future.add_done_callback(lambda _: self._references.pop(seed, None))
        return future

    def watch(self) -> list[str]:
        """Told when nodes come or go."""
        now = sum(bool(node["Alive"]) for node in self._ray.nodes())
        before, self._nodes = self._nodes, now
        return [f"the cluster has {now} nodes now, {before} before"] if now != before else []

    def end(self) -> None:
        """Give up what is under way and leave the cluster."""
        for reference in list(self._references.values()):
            self._ray.cancel(reference, force=True)
        self._ray.shutdown()
