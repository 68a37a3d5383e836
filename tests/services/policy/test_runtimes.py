"""Exported networks: the same answers as torch's, without torch; damage is refused in words."""

import subprocess
import sys
from argparse import ArgumentParser
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from common.errors import ConfigError
from common.tables import validated
from services.policy.checkpoint.exported import ABOUT, FOLDER, STEP
from services.policy.checkpoint.manifest import NETWORK, describe
from services.policy.configuration import ChunkConfig, InputConfig, PolicySettings, ResNetConfig
from services.policy.errors import CheckpointError, PolicyError
from services.policy.kinds import CONFIGS, network
from services.policy.options import add_inference_options, inference_arguments
from services.policy.runtimes.load import load_runtime
from services.policy.serving.config import PolicyConfig, RuntimeName
from tests.services.policy.made import SIZE, small
from tests.services.policy.served import saved

torch = pytest.importorskip("torch", reason="needs the extra policy")
pytest.importorskip("onnx", reason="needs the extra export-policy")
pytest.importorskip("onnxruntime", reason="needs the extra onnx")
from services.policy.networks.export import (  # noqa: E402
    export_checkpoint,
    export_network,
    largest_difference,
)
from services.policy.networks.policy import PolicyNetwork  # noqa: E402

CHANGES: dict[str, dict[str, Any]] = {
    "plain": {},
    "chunks": {"actions": ChunkConfig(steps=4)},
    "deterministic": {"deterministic": True},
    "estimating": {
        "inputs": InputConfig(vision="monoscopic", picture_size=SIZE, estimated=("x", "y"))
    },
    "blind": {"inputs": InputConfig(vision="blind", scene=("yaw",))},
    "resnet": {"encoder": ResNetConfig(width=2, key_points=4, features=8)},
}


def trained(config: PolicySettings) -> PolicyNetwork:
    """Return a network whose normalisations have seen something."""
    torch.manual_seed(0)
    policy = network(config)
    width, height = config.inputs.picture_size
    shape = (2, 8, len(config.inputs.cameras), height, width, 3)
    policy.look(torch.randint(0, 256, shape, dtype=torch.uint8))
    return policy


def answers(folder: Path, runtime: RuntimeName, **config: Any) -> list[Any]:
    """Return what a runtime answers to three requests, the second of which it has seen in part."""
    loaded, description = load_runtime(PolicyConfig(checkpoint=folder, runtime=runtime, **config))
    policy, rng = description.manifest.policy, np.random.default_rng(0)
    width, height = policy.inputs.picture_size
    shape = (9, len(policy.inputs.cameras), height, width, 3)
    pictures = rng.integers(0, 256, shape, dtype=np.uint8)
    observations = rng.normal(size=(9, policy.inputs.width)).astype(np.float32)
    memory = rng.uniform(-0.5, 0.5, policy.memory_shape).astype(np.float32)
    found: list[Any] = []
    for window in (slice(0, 6), slice(3, 9), slice(4, 5)):
        decision, after = loaded.run(observations[window], pictures[window], memory)
        found += [*decision, after]
    return found


@pytest.mark.parametrize("kind", list(CONFIGS))
@pytest.mark.parametrize("changes", CHANGES.values(), ids=list(CHANGES))
def test_the_exported_network_is_torchs(kind: str, changes: dict[str, Any]) -> None:
    policy = trained(small(kind, **changes))
    before = {name: tensor.clone() for name, tensor in policy.state_dict().items()}
    assert largest_difference(policy, export_network(policy)) < 1e-5
    for name, tensor in policy.state_dict().items():
        assert torch.equal(tensor, before[name])


def test_a_difference_is_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    policy = trained(small("trill"))
    exported = export_network(policy)
    with torch.no_grad():
        policy.mlp[0].bias[3] += 0.1
    assert largest_difference(policy, exported) > 1e-4
    folder = saved(tmp_path / "made", small("trill"))
    monkeypatch.setattr("services.policy.networks.export.TOLERANCE", -1.0)
    with pytest.raises(PolicyError, match="differs from torch's by"):
        export_checkpoint(folder)
    assert not (folder / FOLDER).exists()


@pytest.mark.parametrize("runtime", ["onnx", "openvino"])
def test_every_runtime_answers_as_torch_does(tmp_path: Path, runtime: RuntimeName) -> None:
    if runtime == "openvino":
        pytest.importorskip("openvino", reason="needs the extra openvino")
    for kind in CONFIGS:
        folder = saved(tmp_path / kind, small(kind))
        digest = describe(folder).digest
        export_checkpoint(folder)
        assert describe(folder).digest == digest
        expected = answers(folder, "torch")
        (folder / NETWORK).unlink()
        for got, wanted in zip(answers(folder, runtime), expected, strict=True):
            np.testing.assert_allclose(got, wanted, atol=1e-5)


def test_an_exported_network_is_served_without_torch(tmp_path: Path) -> None:
    folder = saved(tmp_path / "made", small("trill"))
    export_checkpoint(folder)
    program = """
import sys
for name in ("torch", "safetensors", "onnx", "cv2"):
    sys.modules[name] = None  # importing it raises
from services.policy.service import PolicyConfig, PolicyOperator
PolicyOperator(PolicyConfig(checkpoint=sys.argv[1], runtime="onnx")).close()
"""
    command = [sys.executable, "-c", program, str(folder)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr


DAMAGES: dict[str, tuple[Callable[[Path], object], str]] = {
    "never exported": (lambda folder: (folder / ABOUT).unlink(), "has no exported network"),
    "cut short": (lambda folder: (folder / STEP).write_bytes(b"\x08"), "damaged or cut short"),
    "no JSON": (lambda folder: (folder / ABOUT).write_text("{"), "wrong values in"),
    "of another checkpoint": (
        lambda folder: (folder / ABOUT).write_text(
            (folder / ABOUT).read_text().replace('"checkpoint": "', '"checkpoint": "0')
        ),
        "exported from another checkpoint",
    ),
}


@pytest.mark.parametrize(("damage", "words"), DAMAGES.values(), ids=list(DAMAGES))
def test_what_is_not_the_exported_network_is_refused(
    tmp_path: Path, damage: Callable[[Path], object], words: str
) -> None:
    folder = saved(tmp_path / "made", small("bc"))
    export_checkpoint(folder)
    damage(folder / FOLDER)
    with pytest.raises(CheckpointError, match=words) as refused:
        load_runtime(PolicyConfig(checkpoint=folder, runtime="onnx"))
    assert "trill export-policy" in str(refused.value)
    export_checkpoint(folder)
    load_runtime(PolicyConfig(checkpoint=folder, runtime="onnx"))


def test_a_device_that_is_not_there_is_refused(tmp_path: Path) -> None:
    folder = saved(tmp_path / "made", small("bc"))
    export_checkpoint(folder)
    with pytest.raises(PolicyError, match="expected cpu, or cuda"):
        load_runtime(PolicyConfig(checkpoint=folder, runtime="onnx", device="abacus"))
    pytest.importorskip("openvino", reason="needs the extra openvino")
    with pytest.raises(PolicyError, match="device 'abacus': expected cpu"):
        load_runtime(PolicyConfig(checkpoint=folder, runtime="openvino", device="abacus"))


def test_16_bits_are_near_where_the_processor_has_them(tmp_path: Path) -> None:
    openvino = pytest.importorskip("openvino", reason="needs the extra openvino")
    folder = saved(tmp_path / "made", small("trill"))
    export_checkpoint(folder)
    if "BF16" not in openvino.Core().get_property("CPU", "OPTIMIZATION_CAPABILITIES"):
        with pytest.raises(PolicyError, match="no instructions for bfloat16"):
            answers(folder, "openvino", precision="bfloat16")
        return
    exact, near = answers(folder, "torch"), answers(folder, "openvino", precision="bfloat16")
    differences = [np.abs(got - wanted).max() for got, wanted in zip(near, exact, strict=True)]
    assert 1e-6 < max(differences) < 2e-2


def test_16_bits_are_refused_where_they_are_not_computed() -> None:
    with pytest.raises(ConfigError, match="expected precision float32 of the runtime torch"):
        validated(PolicyConfig, {"checkpoint": "none", "precision": "bfloat16"})


def test_options_are_passed_on_as_they_were_given() -> None:
    parser = ArgumentParser()
    add_inference_options(parser)
    words = ["--remote", "--runtime", "openvino", "--threads", "2", "--precision", "bfloat16"]
    assert inference_arguments(parser.parse_args(words)) == tuple(words)
    assert inference_arguments(parser.parse_args([])) == ()
