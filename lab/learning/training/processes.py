"""Several processes of one machine that train one policy together, as ``torchrun`` starts them.

Each learns from its part of every batch, and the gradients are those of the whole batch. The first
process alone writes files and says how it goes.
"""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import timedelta

import torch
from torch import distributed

from lab.errors import TrainingError

_PATIENCE = timedelta(hours=6)
"""The others wait while the first process renders views and validates."""


class Processes:
    """The processes of a training; one, unless :func:`together` says otherwise.

    Attributes:
        rank: number of this process, from 0.
        count: of processes.
    """

    def __init__(self, rank: int = 0, count: int = 1) -> None:
        self.rank, self.count = rank, count

    @property
    def first(self) -> bool:
        """Whether this process writes."""
        return self.rank == 0

    def part(self, batch: int) -> slice:
        """Return which windows of a batch are this process's.

        Raises:
            TrainingError: they cannot be divided.
        """
        if batch % self.count:
            raise TrainingError(
                f"expected a training.batch that {self.count} processes can divide, got {batch}"
            )
        return slice(self.rank, None, self.count)

    def sum(self, numbers: torch.Tensor) -> torch.Tensor:
        """Return the sum over all processes."""
        if self.count > 1:
            distributed.all_reduce(numbers)
        return numbers

    def agreed(self, number: float) -> float:
        """Return the first process's number."""
        if self.count == 1:
            return number
        shared = [number]
        distributed.broadcast_object_list(shared)
        return shared[0]

    @contextmanager
    def in_turn(self) -> Iterator[None]:
        """Let the others begin the block when the first process has ended it."""
        if not self.first:
            distributed.barrier()
        yield
        if self.first and self.count > 1:
            distributed.barrier()


@contextmanager
def together(device: torch.device) -> Iterator[tuple[Processes, torch.device]]:
    """Join the processes that ``torchrun`` has started; yield them and this one's device.

    On processors they speak by gloo, on GPUs by nccl, and each has a GPU of its own.
    """
    count = int(os.environ.get("WORLD_SIZE", "1"))
    if count == 1:
        yield Processes(), device
        return
    rank, cuda = int(os.environ["RANK"]), device.type == "cuda"
    if cuda:
        device = torch.device("cuda", int(os.environ["LOCAL_RANK"]))
        torch.cuda.set_device(device)
    if rank:
        # To rich: no terminal, so that one bar is drawn and not several over each other.
        os.environ["TTY_COMPATIBLE"] = "0"
    distributed.init_process_group("nccl" if cuda else "gloo", timeout=_PATIENCE)
    try:
        yield Processes(rank, count), device
    finally:
        distributed.destroy_process_group()
