"""Lets a torchvision built for other devices be imported beside a CPU build of torch.

Its compiled operators cannot be loaded then, and its import fails only because it misses their
declarations; neither loader uses them.
"""


def make_importable() -> None:
    """Declare the operators that torchvision asks for, unless they are there."""
    import torch

    try:
        import torchvision
    except RuntimeError:
        for name in ("nms", "qnms"):
            torch.library.define(f"torchvision::{name}", "(Tensor d, Tensor s, float t) -> Tensor")
        import torchvision
    del torchvision
