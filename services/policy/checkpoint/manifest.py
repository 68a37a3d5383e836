"""The manifest of a checkpoint: all that its reader has to know; it needs no torch.

    config.json            the manifest: kind, configuration, schema, rates, origin, digests
    processor.json         the processor with its statistics
    network.safetensors    the tensors

Nothing in a checkpoint is ever unpickled: it cannot run code.
"""

import hashlib
import json
from pathlib import Path
from typing import Any, Final, Literal

from pydantic import Field, ValidationError

from common.episodes.columns import RATE
from common.errors import explain
from services.policy.configuration import PolicySettings, StrictModel
from services.policy.errors import CheckpointError
from services.policy.kinds import CONFIGS, AnyConfig
from services.policy.processor.processor import Processor
from services.policy.processor.targets import GAITS

FORMAT: Final = "trill-policy"
SCHEMA_VERSION: Final = 1
MANIFEST, PROCESSOR, NETWORK = "config.json", "processor.json", "network.safetensors"


class Origin(StrictModel):
    """Where a checkpoint comes from.

    Attributes:
        dataset: digest of the data set.
        episodes: how many of its episodes were learned from.
        source: digest of the code that trained it.
        versions: versions of Python and packages.
        operator: who operated the robot in the data set.
        task: scored task of the data set, which evaluation runs; empty: none, or several.
        picture_size: width and height of the data set's pictures, before they were scaled
            [pixels]; evaluation renders the same; None: there are none, or several sizes.
    """

    dataset: str
    episodes: int = Field(ge=0)
    source: str
    versions: dict[str, str]
    operator: str
    task: str = ""
    picture_size: tuple[int, int] | None = None


class Schema(StrictModel):
    """What goes into a policy and comes out of it.

    Attributes:
        observation: parts of the observation vector, in order, and how many numbers each has.
        cameras: whose pictures it sees, in order.
        picture_size: width and height of the pictures [pixels].
        memory: shape of the recurrent state.
        hands: steps and numbers of the actions of hands and neck.
        gaits: number of gaits that it chooses among, none included.
        rate: frames per second.
    """

    observation: tuple[tuple[str, int], ...]
    cameras: tuple[str, ...]
    picture_size: tuple[int, int]
    memory: tuple[int, int, int]
    hands: tuple[int, int]
    gaits: int
    rate: int


def schema_of(config: PolicySettings) -> Schema:
    """Return the schema that this version of the code gives a configuration."""
    return Schema(
        observation=tuple(config.inputs.parts.items()),
        cameras=config.inputs.cameras,
        picture_size=config.inputs.picture_size,
        memory=config.memory_shape,
        hands=config.actions.shape,
        gaits=GAITS,
        rate=RATE,
    )


class Manifest(StrictModel):
    """Describes a checkpoint.

    Attributes:
        format: always ``trill-policy``.
        schema_version: of this manifest.
        policy: configuration of the policy; its ``kind`` is the policy's.
        interface: what goes in and comes out.
        tensors: type and shape of each tensor, for instance ``float32 [3, 4]``.
        origin: where it comes from.
        digests: SHA-256 of the other files, by name.
    """

    format: Literal["trill-policy"] = FORMAT
    schema_version: Literal[1] = SCHEMA_VERSION
    policy: AnyConfig
    interface: Schema
    tensors: dict[str, str]
    origin: Origin
    digests: dict[str, str]


class Description(StrictModel):
    """What can be known of a checkpoint without torch: enough for the robot's side."""

    manifest: Manifest
    processor: Processor
    digest: str = Field(description="SHA-256 of the manifest, which has those of the other files")


def sha256(content: bytes) -> str:
    """Return the digest of a file's content."""
    return hashlib.sha256(content).hexdigest()


def describe(folder: Path, kind: str | None = None) -> Description:
    """Read the manifest and the processor of a checkpoint.

    Args:
        folder: of the checkpoint.
        kind: of the policy that is wanted; None: any.

    Raises:
        CheckpointError: it is none, is damaged, or is of another format, version, kind or schema.
    """
    content = read(folder, MANIFEST)
    manifest = _manifest(folder / MANIFEST, content)
    if kind is not None and manifest.policy.kind != kind:
        raise CheckpointError(
            f"expected a policy of kind {kind} in {folder}, got {manifest.policy.kind}; give "
            "another checkpoint or another kind"
        )
    expected = schema_of(manifest.policy)
    if manifest.interface != expected:
        raise CheckpointError(
            f"{folder} was made for other inputs or outputs than this version has: "
            f"{_differences(expected, manifest.interface)}; use the version that made it "
            f"(source {manifest.origin.source[:12]}), or train it anew"
        )
    path = folder / PROCESSOR
    try:
        processor = Processor.model_validate_json(read_checked(folder, PROCESSOR, manifest))
    except ValidationError as error:
        raise CheckpointError(f"wrong values in {path}:\n{explain(error)}") from error
    if (processor.inputs, processor.actions) != (manifest.policy.inputs, manifest.policy.actions):
        raise CheckpointError(f"{path} is of another policy than {MANIFEST}; copy the folder anew")
    return Description(manifest=manifest, processor=processor, digest=sha256(content))


def _manifest(path: Path, content: bytes) -> Manifest:
    try:
        given: Any = json.loads(content)
    except (ValueError, RecursionError) as error:
        raise CheckpointError(
            f"{path} is no JSON, it is damaged or cut short: {error}; copy the checkpoint anew"
        ) from error
    if not isinstance(given, dict) or given.get("format") != FORMAT:
        raise CheckpointError(
            f'{path} is no checkpoint of a policy: expected "format": "{FORMAT}"; give the folder '
            "that training wrote"
        )
    if given.get("schema_version") != SCHEMA_VERSION:
        raise CheckpointError(
            f"expected version {SCHEMA_VERSION} of the manifest {path}, got "
            f"{given.get('schema_version')}; use the version of the project that made it, or train "
            "it anew"
        )
    policy = given.get("policy")
    kind = policy.get("kind") if isinstance(policy, dict) else None
    if kind not in CONFIGS:
        raise CheckpointError(
            f"expected a policy of kind {', '.join(CONFIGS)} in {path}, got {kind}; use a version "
            "of the project that has it"
        )
    try:
        return Manifest.model_validate_json(content)
    except ValidationError as error:
        raise CheckpointError(f"wrong values in {path}:\n{explain(error)}") from error


def _differences(expected: Schema, got: Schema) -> str:
    return "; ".join(
        f"{name}: expected {value}, got {getattr(got, name)}"
        for name, value in expected
        if value != getattr(got, name)
    )


def read(folder: Path, name: str) -> bytes:
    """Return the content of a checkpoint's file.

    Raises:
        CheckpointError: it cannot be read.
    """
    try:
        return (folder / name).read_bytes()
    except OSError as error:
        raise CheckpointError(
            f"cannot read {name} of the checkpoint {folder}: {error.strerror}; expected a folder "
            f"with {MANIFEST}, {PROCESSOR} and {NETWORK}"
        ) from error


def read_checked(folder: Path, name: str, manifest: Manifest) -> bytes:
    """Return the content of a checkpoint's file, if it is the one that was written.

    Raises:
        CheckpointError: it cannot be read, or its digest is another.
    """
    content = read(folder, name)
    # The first bytes of a pickle, and of the archive in which torch.save puts one. Safetensors may
    # begin with the same byte, of the length of their header, which begins with a brace.
    pickled = content[:1] == b"\x80" and content[8:9] != b"{"
    if pickled or content[:4] == b"PK\x03\x04":
        raise CheckpointError(
            f"{folder / name} is a pickle, which could run any code; it is not read. Expected "
            "the file that training wrote; nothing in a checkpoint is ever unpickled"
        )
    expected, got = manifest.digests.get(name, "none"), sha256(content)
    if got != expected:
        raise CheckpointError(
            f"{folder / name} is damaged, cut short or of another checkpoint: expected SHA-256 "
            f"{expected[:12]}…, got {got[:12]}… of {len(content)} bytes; copy the folder anew"
        )
    return content
