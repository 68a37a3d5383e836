"""A network exported to ONNX, in the folder of its checkpoint; this needs no torch.

    onnx/look.onnx      pictures of one frame to what the network sees in them
    onnx/step.onnx      observations, what was seen, and memory to a decision and memory
    onnx/export.json    of which checkpoint, by which versions, SHA-256 of both

The checkpoint itself stays as it is, and so does its digest.
"""

import shutil
from pathlib import Path
from typing import Final, Literal, NamedTuple

from pydantic import ValidationError

from common.errors import explain
from common.files import write_folder
from services.policy.checkpoint.manifest import Description, sha256
from services.policy.configuration import StrictModel
from services.policy.errors import CheckpointError

FOLDER, ABOUT, LOOK, STEP = "onnx", "export.json", "look.onnx", "step.onnx"
FORMAT: Final = "trill-onnx"


class ExportFile(StrictModel):
    """Content of ``export.json``.

    Attributes:
        format: always ``trill-onnx``.
        checkpoint: SHA-256 of the manifest of the checkpoint that was exported.
        digests: SHA-256 of the networks' files, by name.
        versions: versions of the packages that exported it.
    """

    format: Literal["trill-onnx"] = FORMAT
    checkpoint: str
    digests: dict[str, str]
    versions: dict[str, str]


class Exported(NamedTuple):
    """The two parts of a network as ONNX models.

    Attributes:
        look: ``pictures`` (cameras, height, width, 3) uint8 to ``seen`` (m,); empty: it sees none.
        step: ``observation`` (t, n), ``seen`` (t, m) and ``memory`` before the first frame to
            ``hands``, ``grasp`` and ``gait`` of the last frame, and ``after``, the memory then.
    """

    look: bytes
    step: bytes


def write_exported(
    checkpoint: Path, description: Description, exported: Exported, versions: dict[str, str]
) -> Path:
    """Write a network beside its checkpoint, whole or not at all, in place of an older one.

    Returns:
        the folder.

    Raises:
        CheckpointError: it cannot be written.
    """
    contents = {LOOK: exported.look, STEP: exported.step}
    about = ExportFile(
        checkpoint=description.digest,
        digests={name: sha256(content) for name, content in contents.items()},
        versions=versions,
    )
    contents[ABOUT] = about.model_dump_json(indent=1).encode()
    folder = checkpoint / FOLDER
    try:
        if folder.exists():
            shutil.rmtree(folder)
        write_folder(folder, contents)
    except OSError as error:
        raise CheckpointError(
            f"cannot write {folder}: {error}; copy the checkpoint to a folder of yours"
        ) from error
    return folder


def read_exported(checkpoint: Path, description: Description) -> Exported:
    """Return the exported network of a checkpoint.

    Raises:
        CheckpointError: there is none, it is damaged, or of another checkpoint.
    """
    folder = checkpoint / FOLDER
    mend = f"export it (again): trill export-policy {checkpoint}, where torch is"
    try:
        about = ExportFile.model_validate_json((folder / ABOUT).read_bytes())
        contents = {name: (folder / name).read_bytes() for name in (LOOK, STEP)}
    except OSError as error:
        raise CheckpointError(
            f"{checkpoint} has no exported network: {error.strerror}: {error.filename}; {mend}"
        ) from error
    except ValidationError as error:
        raise CheckpointError(f"wrong values in {folder / ABOUT}:\n{explain(error)}\n{mend}") from (
            error
        )
    if about.checkpoint != description.digest:
        raise CheckpointError(
            f"{folder} was exported from another checkpoint: expected {description.digest[:12]}…, "
            f"got {about.checkpoint[:12]}…; {mend}"
        )
    for name, content in contents.items():
        if sha256(content) != about.digests.get(name):
            raise CheckpointError(f"{folder / name} is damaged or cut short; {mend}")
    return Exported(contents[LOOK], contents[STEP])
