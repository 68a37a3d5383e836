"""Checkpoints: written whole, read with all checks, nothing unpickled, no torch on the robot."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from services.policy.checkpoint.manifest import (
    MANIFEST,
    NETWORK,
    PROCESSOR,
    Origin,
    describe,
    sha256,
)
from services.policy.configuration import PolicySettings
from services.policy.errors import CheckpointError
from services.policy.kinds import CONFIGS, network
from services.policy.processor.processor import Processor
from tests.services.policy.made import episode, small

torch = pytest.importorskip("torch", reason="needs the extra policy")
pytest.importorskip("safetensors", reason="needs the extra policy")
from safetensors.torch import load, save  # noqa: E402

from services.policy.checkpoint.folder import load_checkpoint, save_checkpoint  # noqa: E402

ORIGIN = Origin(
    dataset="d" * 64, episodes=3, source="s" * 64, versions={"torch": "2"}, operator="synthetic"
)


def written(folder: Path, config: PolicySettings | None = None) -> Path:
    config = config or small("trill")
    torch.manual_seed(0)
    processor = Processor.fit(config, [episode(seed) for seed in range(3)])
    save_checkpoint(folder / "made", network(config), processor, ORIGIN)
    return folder / "made"


def edit(folder: Path, change: Callable[[dict[str, Any]], object]) -> None:
    """Change the manifest."""
    given = json.loads((folder / MANIFEST).read_bytes())
    change(given)
    (folder / MANIFEST).write_text(json.dumps(given))


def replace(folder: Path, name: str, content: bytes) -> None:
    """Replace a file and its digest, as a program other than this would write it."""
    (folder / name).write_bytes(content)
    edit(folder, lambda given: given["digests"].update({name: sha256(content)}))


@pytest.mark.parametrize("kind", list(CONFIGS))
def test_a_checkpoint_read_again_is_the_policy_that_was_written(tmp_path: Path, kind: str) -> None:
    config = small(kind)
    torch.manual_seed(0)
    made = network(config).eval()
    processor = Processor.fit(config, [episode(seed) for seed in range(3)])
    digest = save_checkpoint(tmp_path / "made", made, processor, ORIGIN)

    read, description = load_checkpoint(tmp_path / "made", kind)
    assert description.digest == digest
    assert description.processor == processor
    assert read.config == config
    assert description.manifest.origin == ORIGIN
    assert {path.name for path in (tmp_path / "made").iterdir()} == {MANIFEST, PROCESSOR, NETWORK}
    assert [path.name for path in tmp_path.iterdir()] == ["made"]
    for name, tensor in made.state_dict().items():
        assert torch.equal(read.state_dict()[name], tensor)
    assert not read.training


def test_a_checkpoint_is_never_written_over_another(tmp_path: Path) -> None:
    folder = written(tmp_path)
    before = (folder / NETWORK).read_bytes()
    with pytest.raises(CheckpointError, match="there already; choose another folder"):
        written(tmp_path)
    assert (folder / NETWORK).read_bytes() == before


def test_a_checkpoint_of_another_kind_is_refused(tmp_path: Path) -> None:
    folder = written(tmp_path, small("bc"))
    with pytest.raises(CheckpointError, match=r"expected a policy of kind trill .*, got bc; give"):
        load_checkpoint(folder, "trill")
    edit(folder, lambda given: given["policy"].update(kind="diffusion"))
    with pytest.raises(CheckpointError, match=r"expected .* trill, bc-rnn, bc .*, got diffusion"):
        load_checkpoint(folder)


def _without_a_part(given: dict[str, Any]) -> None:
    given["interface"]["observation"].pop()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda given: given.update(schema_version=2), "expected version 1 .*, got 2; use"),
        (lambda given: given.update(format="other"), 'expected "format": "trill-policy"'),
        (lambda given: given.update(colour="red"), "colour: no such key"),
        (lambda given: given["policy"].update(wings=2), "wings: no such key"),
        (_without_a_part, "observation: expected .*control_state.*, got .*; use the version"),
        (lambda given: given["interface"].update(rate=10), "rate: expected 20, got 10"),
        (lambda given: given["tensors"].pop("mlp.0.bias"), "config.json .* missing mlp.0.bias"),
        (
            lambda given: given["policy"].update(mlp=[10**9]),
            r"gait.weight: expected float32 \[6, 1000000000\]",
        ),
        (lambda given: given["policy"]["inputs"].update(vision="blind"), "other inputs or outputs"),
    ],
)
def test_a_manifest_of_another_schema_is_refused(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], words: str
) -> None:
    folder = written(tmp_path)
    edit(folder, change)
    with pytest.raises(CheckpointError, match=words):
        load_checkpoint(folder)


@pytest.mark.parametrize("name", [MANIFEST, PROCESSOR, NETWORK])
def test_a_file_cut_short_or_missing_is_refused(tmp_path: Path, name: str) -> None:
    folder = written(tmp_path)
    content = (folder / name).read_bytes()
    for cut in (0, 5, len(content) // 2, len(content) - 1):
        (folder / name).write_bytes(content[:cut])
        with pytest.raises(CheckpointError, match=r"cut short.*copy the .* anew"):
            load_checkpoint(folder)
    (folder / name).unlink()
    with pytest.raises(CheckpointError, match=f"cannot read {name}"):
        load_checkpoint(folder)


def test_a_flipped_bit_is_noticed(tmp_path: Path) -> None:
    folder = written(tmp_path)
    content = bytearray((folder / NETWORK).read_bytes())
    content[-3] ^= 1
    (folder / NETWORK).write_bytes(bytes(content))
    with pytest.raises(CheckpointError, match="damaged"):
        load_checkpoint(folder)


@pytest.mark.parametrize("archive", [True, False])
def test_a_pickle_is_never_unpickled(tmp_path: Path, archive: bool) -> None:
    folder = written(tmp_path)
    ran = tmp_path / "ran"

    class Trap:
        def __reduce__(self) -> tuple[Any, ...]:
            return (Path.touch, (ran,))

    path = folder / "made"
    torch.save({"mlp.0.bias": Trap()}, path, _use_new_zipfile_serialization=archive)
    replace(folder, NETWORK, path.read_bytes())
    with pytest.raises(CheckpointError, match="is a pickle, which could run any code"):
        load_checkpoint(folder)
    assert not ran.exists()


def test_a_network_whose_file_begins_like_a_pickle_is_read(tmp_path: Path) -> None:
    folder = written(tmp_path)
    tensors = load((folder / NETWORK).read_bytes())
    # The first byte is of the header's length.
    files = (save(tensors, {"about": "x" * length}) for length in range(0, 512, 8))
    replace(folder, NETWORK, next(file for file in files if file[0] == 0x80))
    network, _ = load_checkpoint(folder)
    assert torch.equal(network.state_dict()["mlp.0.bias"], tensors["mlp.0.bias"])


def _renamed(tensors: dict[str, Any]) -> None:
    tensors["mlp.9.bias"] = tensors.pop("mlp.0.bias")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda tensors: tensors.pop("mlp.0.bias"), "missing mlp.0.bias"),
        (lambda tensors: tensors.update(more=torch.zeros(1)), "unknown more"),
        (_renamed, "missing mlp.0.bias; unknown mlp.9.bias"),
        (
            lambda tensors: tensors.update({"mlp.0.bias": torch.zeros(32, dtype=torch.int32)}),
            r"mlp.0.bias: expected float32 \[32\], got int32 \[32\]",
        ),
        (
            lambda tensors: tensors.update({"mlp.0.bias": torch.zeros(32, 1)}),
            r"got float32 \[32, 1\]",
        ),
        (
            lambda tensors: tensors["mlp.0.bias"].fill_(float("nan")),
            "NaN or infinity in mlp.0.bias",
        ),
    ],
)
def test_other_tensors_are_named(
    tmp_path: Path, change: Callable[[dict[str, Any]], object], words: str
) -> None:
    folder = written(tmp_path)
    tensors = load((folder / NETWORK).read_bytes())
    change(tensors)
    replace(folder, NETWORK, save(tensors))
    with pytest.raises(CheckpointError, match=words):
        load_checkpoint(folder)


def test_what_is_no_safetensors_file_is_refused_by_its_name(tmp_path: Path) -> None:
    folder = written(tmp_path)
    replace(folder, NETWORK, b"hello, this is no tensor")
    with pytest.raises(CheckpointError, match="is no safetensors file"):
        load_checkpoint(folder)


def test_statistics_of_another_width_are_refused(tmp_path: Path) -> None:
    folder = written(tmp_path)
    given = json.loads((folder / PROCESSOR).read_bytes())
    given["observation"]["mean"].pop()
    given["observation"]["scale"].pop()
    replace(folder, PROCESSOR, json.dumps(given).encode())
    with pytest.raises(CheckpointError, match="expected statistics of 109 measured"):
        describe(folder)


def test_the_robots_side_needs_neither_torch_nor_safetensors_nor_h5py(tmp_path: Path) -> None:
    folder = written(tmp_path)
    arrays = {name: column[4] for name, column in episode(1).items()}
    np.savez(tmp_path / "frame.npz", **arrays)
    program = """
import sys
for name in ("torch", "safetensors", "h5py", "cv2"):
    sys.modules[name] = None  # importing it raises
import numpy as np
from pathlib import Path
from services.policy.checkpoint.manifest import describe
from services.policy.processor.actions import Command
from services.policy.processor.pictures import scale_picture
from services.policy.processor.processor import Decision
from services.policy.service import PolicyConfig, PolicyOperator
from services.policy.serving.remote import RemoteEngine
found = describe(Path(sys.argv[1]), "trill")
frame = dict(np.load(sys.argv[2]))
start = Command(frame["action/hands"], 0.0)
vector = found.processor.frame(frame, start)
picture = scale_picture(np.zeros((90, 120, 3), np.uint8), found.manifest.policy.inputs.picture_size)
still = Decision(np.zeros((1, 14), np.float32), np.zeros((1, 2), np.float32), np.eye(7)[0])
(command,) = found.processor.commands(still, start)
memory = np.zeros(found.manifest.policy.memory_shape, np.float32)
config = PolicyConfig(checkpoint=sys.argv[1], remote=True)
PolicyOperator(config, RemoteEngine(found, 1.0), found)
print(len(vector), *picture.shape, len(command.hands), memory.nbytes)
"""
    done = subprocess.run(
        [sys.executable, "-c", program, str(folder), str(tmp_path / "frame.npz")],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.stdout.split() == ["117", "18", "24", "3", "14", "256"], done.stderr
