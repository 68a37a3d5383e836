"""Command-line options that say where and by what a policy is computed."""

import argparse
from typing import Any, get_args

from services.policy.serving.config import Precision, RuntimeName


def add_runtime_options(add: Any) -> None:
    """Add what computes, to a parser or a group; options that are not given get no attribute."""
    quiet: dict[str, Any] = {"default": argparse.SUPPRESS}
    add.add_argument(
        "--runtime",
        choices=get_args(RuntimeName),
        help="what computes; onnx and openvino need no torch, but a network that "
        "`trill export-policy` has exported (torch)",
        **quiet,
    )
    add.add_argument("--device", help="of the runtime: cpu, cuda, cuda:1 (cpu)", **quiet)
    add.add_argument("--threads", type=int, help="of the runtime on the CPU (1)", **quiet)
    add.add_argument(
        "--precision",
        choices=get_args(Precision),
        help="in which openvino looks at pictures (float32)",
        **quiet,
    )


def add_inference_options(add: Any) -> None:
    """Add where a policy's answers are computed, and by what."""
    add.add_argument(
        "--remote",
        action="store_true",
        default=argparse.SUPPRESS,
        help="an inference server computes: python -m services.policy.server",
    )
    add_runtime_options(add)


def inference_arguments(arguments: argparse.Namespace) -> tuple[str, ...]:
    """Return those of these options that were given, as words for another command line."""
    given = vars(arguments)
    words = ["--remote"] if given.get("remote") else []
    for name in ("runtime", "device", "threads", "precision"):
        if name in given:
            words += [f"--{name}", str(given[name])]
    return tuple(words)
