"""Run robomimic's own scripts on an export, as the export says that they are run."""

import json
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from verification.loaders.collected import MismatchError

_EPOCHS, _STEPS, _BATCH = 1, 3, 2
"""Little to do: a batch with pictures takes a processor half a minute."""
_RUNNER = """
import runpy, sys
from verification.loaders.torchvision_shim import declare_torchvision_operators
declare_torchvision_operators()
module = sys.argv[1]
del sys.argv[0]
runpy.run_module(module, run_name="__main__")
"""


def run_scripts(export: Path, *, later: bool, scaled: bool) -> dict[str, Any]:
    """Train by the configuration beside the export, and ask for its figures if it is scaled.

    Args:
        export: the export.
        later: whether it has the observations after actions; then a value is learnt, too.
        scaled: whether its actions are within -1 ... 1.

    Raises:
        MismatchError: a script does not do its work. Its exit code is 0 even if it fails.
    """
    config = export.with_name(f"{export.name.removesuffix('.hdf5')}.config.json")
    content = json.loads(config.read_text())
    report = {"trained by its configuration": _train(content)}
    if later:
        del content["algo"]
        low_dim = {"low_dim": content["observation"]["modalities"]["obs"]["low_dim"]}
        content |= {"algo_name": "iql", "observation": {"modalities": {"obs": low_dim}}}
        content["train"] |= {"seq_length": 1}
        report["trained by it with iql"] = _train(content)
    if scaled:
        said = _run("robomimic.scripts.get_dataset_info", "--dataset", str(export))
        if "Traceback" in said:
            raise MismatchError(f"get_dataset_info refuses it: {said[-2000:]}")
        report["get_dataset_info"] = "takes it"
    return report


def _train(content: dict[str, Any]) -> str:
    """Run the training script by a configuration, for a few small steps; return what it came to."""
    with tempfile.TemporaryDirectory() as folder:
        content["experiment"] |= {
            "epoch_every_n_steps": _STEPS,
            "validation_epoch_every_n_steps": _STEPS,
        }
        content["train"] |= {"num_epochs": _EPOCHS, "batch_size": _BATCH, "output_dir": folder}
        config = Path(folder, "config.json")
        config.write_text(json.dumps(content))
        said = _run("robomimic.scripts.train", "--config", str(config))
    validated = ["Validation Epoch"] if content["experiment"]["validate"] else []
    wanted = ["finished run successfully", *validated]
    if missing := [words for words in wanted if words not in said]:
        raise MismatchError(f"training by {config} says nothing of {missing}: {said[-2000:]}")
    return "finished" + (", with validation" if validated else "")


def _run(module: str, *arguments: str) -> str:
    command = [sys.executable, "-c", _RUNNER, module, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, input="")
    return done.stdout + done.stderr
