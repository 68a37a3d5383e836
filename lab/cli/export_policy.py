"""``trill export-policy``: export a policy's network for runtimes other than torch."""

import argparse
from pathlib import Path

from common.packages import require
from lab.cli.commands import Action

TEXT = """Export the network of a checkpoint to ONNX, into the folder onnx/ of the checkpoint, which
else stays as it is. Copied to a machine without torch it is served there by ONNX Runtime or
OpenVINO, in a third to three quarters of torch's time on a processor core: `--runtime onnx` or
`--runtime openvino` of trill up, trill demo, python -m services.policy and its server.

The exported network is compared with torch's on random frames before it is kept.

Exit code: 0 exported, 1 not, 2 wrong options."""
EXAMPLES = """examples:
  trill export-policy runs/policies/door-unlock/best
  trill demo --policy runs/policies/door-unlock/best --runtime onnx
  trill eval runs/policies/door-unlock/best --serve runtime=openvino
"""


def _add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "checkpoint", type=Path, metavar="CHECKPOINT", help="folder that training wrote"
    )


def _run(arguments: argparse.Namespace) -> int:
    require("trill export-policy", "export-policy", "torch", "safetensors", "onnx", "onnxruntime")
    from services.policy.networks.export import export_checkpoint

    folder, difference = export_checkpoint(arguments.checkpoint)
    print(f"{folder}: differs from torch by at most {difference:.1e} on random frames")
    return 0


ACTION = Action(TEXT, EXAMPLES, _add_arguments, _run)
