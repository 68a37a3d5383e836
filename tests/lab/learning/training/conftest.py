"""Let torch compute on one thread: on busy cores several wait for each other."""

from contextlib import suppress

with suppress(ImportError):
    import torch

    torch.set_num_threads(1)
