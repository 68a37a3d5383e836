"""Write and read whole checkpoints, with the network; this needs torch and safetensors."""

from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import load, save
from torch import Tensor

from common.files import write_folder
from services.policy.checkpoint.manifest import (
    MANIFEST,
    NETWORK,
    PROCESSOR,
    Description,
    Manifest,
    Origin,
    describe,
    read_checked,
    schema_of,
    sha256,
)
from services.policy.errors import CheckpointError
from services.policy.kinds import network as new_network
from services.policy.networks.policy import PolicyNetwork
from services.policy.processor.processor import Processor


def save_checkpoint(
    folder: Path, network: PolicyNetwork, processor: Processor, origin: Origin
) -> str:
    """Write a checkpoint, whole or not at all; return its digest.

    Raises:
        CheckpointError: the folder is there already, or cannot be written.
    """
    tensors = {name: t.detach().cpu().contiguous() for name, t in network.state_dict().items()}
    contents = {
        PROCESSOR: processor.model_dump_json(indent=1).encode(),
        NETWORK: save(tensors),
    }
    manifest = Manifest.model_validate(
        {
            "policy": network.config.model_dump(),
            "interface": schema_of(network.config),
            "tensors": {name: _kind(tensor) for name, tensor in tensors.items()},
            "origin": origin,
            "digests": {name: sha256(content) for name, content in contents.items()},
        }
    )
    contents[MANIFEST] = manifest.model_dump_json(indent=1).encode()
    try:
        write_folder(folder, contents)
    except OSError as error:
        raise CheckpointError(
            f"cannot write the checkpoint {folder}: {error}; choose another folder"
        ) from error
    return sha256(contents[MANIFEST])


def load_checkpoint(folder: Path, kind: str | None = None) -> tuple[PolicyNetwork, Description]:
    """Return the network of a checkpoint, ready to be served, and what else it holds.

    Args:
        folder: of the checkpoint.
        kind: of the policy that is wanted; None: any.

    Raises:
        CheckpointError: it is none, is damaged, or is of another format, version, kind or schema;
            or its tensors are not those of the network, or not finite.
    """
    description = describe(folder, kind)
    path = folder / NETWORK
    content = read_checked(folder, NETWORK, description.manifest)
    try:
        tensors = load(content)
    except SafetensorError as error:
        raise CheckpointError(f"{path} is no safetensors file: {error}") from error
    # Without memory for weights until they are known to fit, and without drawing random ones.
    with torch.device("meta"):
        network = new_network(description.manifest.policy)
    _check(path, network.state_dict(), tensors, description.manifest)
    network.load_state_dict(tensors, assign=True)
    return network.to(memory_format=torch.channels_last).eval(), description


def _check(
    path: Path, wanted: dict[str, Tensor], got: dict[str, Tensor], manifest: Manifest
) -> None:
    """Check what ``load_state_dict`` takes in silence: other types, NaN, and an edited manifest."""
    expected = {name: _kind(tensor) for name, tensor in wanted.items()}
    found = {name: _kind(tensor) for name, tensor in got.items()}
    for given, where in ((found, path), (manifest.tensors, path.with_name(MANIFEST))):
        if faults := _faults(expected, given):
            raise CheckpointError(
                f"the tensors in {where} are not those of a policy of kind "
                f"{manifest.policy.kind} as configured: {'; '.join(faults)}; copy the folder anew"
            )
    wrong = [name for name, tensor in got.items() if not bool(torch.isfinite(tensor).all())]
    if wrong:
        raise CheckpointError(
            f"expected finite numbers in {path}, got NaN or infinity in {_some(wrong)}; the "
            "training diverged, take an earlier checkpoint"
        )


def _faults(expected: dict[str, str], got: dict[str, str]) -> list[str]:
    faults = []
    if missing := sorted(expected.keys() - got.keys()):
        faults.append(f"missing {_some(missing)}")
    if extra := sorted(got.keys() - expected.keys()):
        faults.append(f"unknown {_some(extra)}")
    other = [n for n in sorted(expected.keys() & got.keys()) if expected[n] != got[n]]
    faults += [f"{name}: expected {expected[name]}, got {got[name]}" for name in other[:3]]
    return faults


def _some(names: list[str]) -> str:
    more = f" and {len(names) - 3} more" if len(names) > 3 else ""
    return ", ".join(names[:3]) + more


def _kind(tensor: Tensor) -> str:
    return f"{str(tensor.dtype).removeprefix('torch.')} {list(tensor.shape)}"
