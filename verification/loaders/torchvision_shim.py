"""Make a torchvision built for other devices importable beside a CPU build of torch.

Its compiled operators cannot be loaded then, and its import fails because their declarations are
missing. Neither loader uses them.
"""


def declare_torchvision_operators() -> None:
    """Declare the operators that torchvision needs, unless they are loaded."""
    import torch

    try:
        import torchvision
    except RuntimeError:
        for name in ("nms", "qnms"):
            torch.library.define(f"torchvision::{name}", "(Tensor d, Tensor s, float t) -> Tensor")
        import torchvision
    del torchvision
