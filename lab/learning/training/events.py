"""Writes a training's metrics for TensorBoard, if its package is installed."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib.util import find_spec
from pathlib import Path

EVENTS = "tensorboard"
"""Folder of the event files."""
Write = Callable[[int, Mapping[str, float]], None]
"""Writes scalars by name, at a step."""


@contextmanager
def event_files(root: Path, step: int) -> Iterator[Write]:
    """Yield what writes scalars into event files below ``root``, or does nothing.

    Args:
        root: folder of the training.
        step: from which on it goes on; what an earlier run wrote of later steps is hidden.
    """
    if find_spec("tensorboard") is None:
        yield lambda _step, _scalars: None
        return
    from torch.utils.tensorboard import SummaryWriter

    with SummaryWriter(str(root / EVENTS), purge_step=step) as writer:

        def write(at: int, scalars: Mapping[str, float]) -> None:
            for name, value in scalars.items():
                writer.add_scalar(name, value, at)
            writer.flush()

        yield write
