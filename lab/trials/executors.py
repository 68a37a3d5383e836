"""Workers on a Ray cluster, and the choice between those and processes of this machine."""

import socket
from collections.abc import Callable
from concurrent.futures import Future
from typing import Any, TypeVar

from common.packages import install_hint
from lab.errors import LabError
from lab.trials.campaign import Executor
from lab.trials.workers import WORKER_ENVIRONMENT, LocalExecutor

T = TypeVar("T")

_TIMEOUT = 10.0
"""A cluster must answer within this time [s]."""


def open_executor(jobs: int | None, ray_address: str | None, default_jobs: int = 1) -> Executor:
    """Return workers: on the Ray cluster at ``ray_address``, or processes of this machine.

    Args:
        jobs: number of workers; None: ``default_jobs`` here, or the cluster's processors.
        ray_address: as for :class:`RayExecutor`; None or empty: this machine.
        default_jobs: number of processes of this machine if ``jobs`` is None.

    Raises:
        LabError: Ray is not installed, or no cluster answers.
    """
    if ray_address:
        return RayExecutor(ray_address, jobs)
    return LocalExecutor(jobs or default_jobs)


class RayExecutor:
    """Workers of a Ray cluster; every node needs this package with its extra ``ray``.

    Arguments and results travel through Ray, so the nodes need no common file system. Work whose
    node is lost is run again on another.

    Attributes:
        size: number of workers.
        lost: exceptions that a future raises when its worker is gone for good.
    """

    def __init__(self, address: str, jobs: int | None) -> None:
        """Join the cluster.

        Args:
            address: ``auto``, ``HOST:PORT``, ``ray://HOST:PORT``, or ``local`` for a new cluster
                on this machine.
            jobs: work at a time; None: as much as the cluster has processors.

        Raises:
            LabError: Ray is not installed, or no cluster answers at the address.
        """
        try:
            import ray
        except ImportError as error:
            raise LabError(
                f"--ray needs the package ray: {install_hint('ray')}, here and on every node"
            ) from error
        self._ray: Any = ray
        _check_address(address)
        # Variables of the process that starts a worker would not reach another machine.
        environment = {"env_vars": WORKER_ENVIRONMENT}
        try:
            ray.init(address=address, log_to_driver=False, runtime_env=environment)
        except (ConnectionError, ValueError, RuntimeError) as error:
            # Ray refuses nodes of another version of itself or of Python and names both.
            raise LabError(
                f"no Ray cluster at {address!r} (this machine has Ray {ray.__version__}): {error}"
            ) from error
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
        self._call: Any = ray.remote(num_cpus=1, max_retries=3)(_call)
        self._references: set[Any] = set()
        self._nodes = self._count_nodes()

    def submit(self, work: Callable[..., T], /, *arguments: object) -> "Future[T]":
        """Start ``work(*arguments)`` on a node."""
        reference = self._call.remote(work, arguments)
        self._references.add(reference)
        future: Future[T] = reference.future()
        future.add_done_callback(lambda _: self._references.discard(reference))
        return future

    def watch(self) -> list[str]:
        """Report when nodes come or go."""
        before, self._nodes = self._nodes, self._count_nodes()
        if self._nodes == before:
            return []
        return [f"the cluster has {self._nodes} nodes now, it had {before} before"]

    def end(self) -> None:
        """Cancel all work and leave the cluster."""
        for reference in list(self._references):
            self._ray.cancel(reference, force=True)
        self._ray.shutdown()

    def _count_nodes(self) -> int:
        return sum(bool(node["Alive"]) for node in self._ray.nodes())


def _call(work: Callable[..., T], arguments: tuple[object, ...]) -> T:
    return work(*arguments)


def _check_address(address: str) -> None:
    """Connect to the cluster's port once; Ray itself would try for many minutes.

    Raises:
        LabError: nothing answers at ``address``.
    """
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if not colon:
        return
    try:
        socket.create_connection((host.strip("[]"), int(port)), timeout=_TIMEOUT).close()
    except (OSError, ValueError) as error:
        raise LabError(
            f"no Ray cluster at {address!r}: {error}; expected auto, HOST:PORT as `ray start "
            "--head` prints it, or ray://HOST:PORT"
        ) from error
