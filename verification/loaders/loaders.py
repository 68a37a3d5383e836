"""The projects whose loaders must accept the exports: how to install and run them."""

import hashlib
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from lab.demonstrations.export.fields import ExportColumns
from lab.errors import DatasetError

TORCH = ("torch==2.13.0",)
_TIMEOUT_S = 3600.0
"""Timeout of an installation step, and of loading everything [s]."""
_READY = "installed"
Report = Callable[[str], None]


@dataclass(frozen=True)
class ExportOptions:
    """Options of an export.

    Attributes:
        columns: the exported numbers.
        write: options of the format's own.
    """

    columns: ExportColumns = field(default_factory=ExportColumns)
    write: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Loader:
    """A project's loader.

    Attributes:
        name: name and version of the project.
        pythons: versions of Python that it supports, the preferred one first.
        without_dependencies: packages installed without their dependencies, because they pin old
            versions or depend on what only their robots and simulators need.
        packages: what loading needs besides.
        module: module of the check.
        exports: options of the exports that it must load, by title.
    """

    name: str
    pythons: tuple[str, ...]
    without_dependencies: tuple[str, ...]
    packages: tuple[str, ...]
    module: str
    exports: dict[str, ExportOptions]

    @property
    def form(self) -> str:
        """Name of the format that it reads."""
        return self.name.partition("-")[0]


_READING = ("numpy>=2,<3", "h5py>=3.12,<4", "opencv-python-headless>=5,<6")
_LEROBOT = (
    *_READING,
    *("accelerate>=1.10,<2", "deepdiff>=8,<10", "einops>=0.8,<1", "gymnasium>=1.1,<2"),
    *("imageio>=2.34,<3", "jsonlines>=4,<5", "packaging>=24", "pandas>=2.2,<4", "pillow>=11"),
    *("pyarrow>=21,<27", "pyserial>=3.5,<4", "safetensors>=0.4,<1", "termcolor>=2.4", "tqdm"),
)
FEW = ExportColumns(parts=("feet", "hands", "grippers", "controller"), gait="held")
_EMBEDDED = {
    "pictures embedded": ExportOptions(write={"video": False}),
    "31 numbers, gait held": ExportOptions(FEW, {"video": False}),
}
LOADERS = (
    Loader(
        name="robomimic-0.3",
        pythons=("3.11", "3.12"),
        without_dependencies=("robomimic==0.3.0", "torchvision==0.28.0"),
        packages=(
            *_READING,
            *("huggingface_hub<2", "imageio>=2.34,<3", "matplotlib>=3.10,<4", "psutil", "six"),
            *("tensorboard>=2.16,<3", "tensorboardX>=2.6,<3", "termcolor", "tqdm"),
        ),
        module="verification.loaders.robomimic_check",
        exports={
            "scaled": ExportOptions(),
            "as collected, compressed": ExportOptions(
                write={"scale_actions": False, "compress": True}
            ),
            "few numbers, gait by column, next observations": ExportOptions(
                ExportColumns(parts=("hands", "grippers"), gait="held-one-hot"),
                {"next_obs": True},
            ),
        },
    ),
    Loader(
        name="lerobot-0.4",
        pythons=("3.11",),
        without_dependencies=("lerobot==0.4.4", "torchvision==0.28.0"),
        packages=(
            *_LEROBOT,
            *("av>=15,<19", "datasets>=4,<4.2", "diffusers>=0.30,<1", "draccus==0.10.0"),
            "huggingface_hub>=0.34,<1",
        ),
        module="verification.loaders.lerobot_check",
        exports=_EMBEDDED,  # torchvision has no longer the video decoders that it uses
    ),
    Loader(
        name="lerobot-0.6",
        pythons=("3.12",),
        without_dependencies=("lerobot==0.6.1", "torchvision==0.28.0"),
        packages=(
            *_LEROBOT,
            *("av>=15,<16", "datasets>=4.8,<5", "draccus>=0.11.6,<0.12", "huggingface_hub>=1.6,<2"),
        ),
        module="verification.loaders.lerobot_check",
        exports={"video": ExportOptions(write={"video": True}), **_EMBEDDED},
    ),
)


def python_of(loader: Loader) -> str | None:
    """Return an interpreter that the loader supports, or None if this machine has none."""
    for version in loader.pythons:
        if version == f"{sys.version_info.major}.{sys.version_info.minor}":
            return sys.executable
        found = shutil.which(f"python{version}")
        # A version manager may offer a command for a Python that is not installed.
        if (
            found
            and subprocess.run([found, "-c", ""], capture_output=True, check=False).returncode == 0
        ):
            return found
    return None


def install(loader: Loader, python: str, venv: Path, report: Report) -> Path:
    """Create the venv, unless it exists, and return its interpreter.

    Raises:
        DatasetError: a package cannot be installed.
    """
    steps = (TORCH, ("--no-deps", *loader.without_dependencies), loader.packages)
    mark, wanted = venv / _READY, hashlib.sha256(repr(steps).encode()).hexdigest()
    interpreter = venv / "bin" / "python"
    if mark.exists() and mark.read_text() == wanted:
        return interpreter
    report(f"{loader.name}: installing into {venv}")
    _run([python, "-m", "venv", "--clear", str(venv)])
    for step in steps:
        _run([str(interpreter), "-m", "pip", "install", "-q", *step])
    mark.write_text(wanted)
    return interpreter


def run_check(loader: Loader, interpreter: Path, export: Path, roots: list[Path]) -> str:
    """Run the loader's check in its venv and return what it printed.

    Raises:
        DatasetError: the export cannot be loaded or differs from what was collected.
    """
    here = Path(__file__).resolve().parents[2]
    command = [str(interpreter), "-m", loader.module, str(export), *map(str, roots)]
    return _run(command, cwd=here)


def _run(command: list[str], cwd: Path | None = None) -> str:
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=_TIMEOUT_S, cwd=cwd
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        raise DatasetError(f"{' '.join(command)}: {error}") from error
    if done.returncode:
        last = "\n".join((done.stdout + done.stderr).splitlines()[-12:])
        raise DatasetError(f"{' '.join(command)} failed:\n{last}")
    return done.stdout
