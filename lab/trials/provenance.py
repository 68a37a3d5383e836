"""Identifies the code behind a result: a digest of the modules that decide it, and versions."""

import ctypes
import hashlib
import os
import platform
import re
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Self

import numpy as np
from pydantic import BaseModel, ConfigDict

from common import native
from lab.errors import LabError

ROOT = Path(__file__).resolve().parents[2]
_WALKED = ("services.sim.tasks.*",)
"""Packages whose modules are found by walking, not by an import statement."""
_DATA = {".xml", ".json", ".toml", ".npy", ".npz", ".stl", ".obj", ".png", ".c", ".h"}
"""Suffixes of what counts beside a module: data, and the sources of compiled kernels."""
_TIMEOUT = 10.0
_NAME = re.compile(r"\w+")
_COMMENT = re.compile(r"#.*")
_IMPORT = re.compile(
    r"\bfrom\s+(\w[\w.]*)\s+import\s+(\([^)]*\)|[^\n;]*)|\bimport\s+(\w[\w.]*(?:[, \t]+\w[\w.]*)*)"
)
"""An import statement: module and members, or modules."""
PHYSICS = ("mujoco", "pin", "osqp", "daqp", "scipy", "numpy")
"""Packages whose versions can change what the robot does."""
PACKAGES = ("trill", "eclipse-zenoh", "numpy", "pydantic", "mujoco", "pin", "osqp", "daqp")
"""Packages named in the record of a run."""


def _file(module: str) -> Path | None:
    base = ROOT.joinpath(*module.split("."))
    candidates = (base.with_suffix(".py"), base / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


def _modules(package: str) -> list[str]:
    files = ROOT.joinpath(*package.split(".")).rglob("*.py")
    return [".".join(path.relative_to(ROOT).with_suffix("").parts) for path in files]


def _imported(path: Path) -> set[str]:
    """Return every name in ``path`` by which an import statement may mean a module.

    A pattern finds the statements in a tenth of the time of a parser, which each worker would pay.
    What it finds in a text besides is no name of a module, or one module too many.
    """
    names: set[str] = set()
    text = _COMMENT.sub("", path.read_text(encoding="utf-8"))
    for module, members, modules in _IMPORT.findall(text):
        names.update([module, *modules.replace(",", " ").split()])
        names.update(f"{module}.{member}" for member in _NAME.findall(members))
    return names


def closure(*roots: str) -> dict[str, Path]:
    """Return the modules of this project that ``roots`` import, however indirectly, by name.

    A root ``package.*`` stands for all modules of the package.
    """
    todo: list[str] = []
    for root in (*roots, *_WALKED):
        package, star, _ = root.partition(".*")
        todo += _modules(package) if star else [root]
    found: dict[str, Path] = {}
    seen: set[str] = set()
    while todo:
        module = todo.pop().removesuffix(".__init__")
        if module in seen:
            continue
        seen.add(module)
        if (path := _file(module)) is None:
            continue
        found[module] = path
        todo += _imported(path)
        if "." in module:
            todo.append(module.rpartition(".")[0])
    return found


@cache
def digest(*roots: str) -> str:
    """Return the SHA-256 of the files of :func:`closure` and the data beside them.

    It is the same everywhere: neither line ends nor the place of the project count, nor any of
    its other modules.
    """
    modules = set(closure(*roots).values())
    data = {
        path
        for folder in {module.parent for module in modules}
        for path in folder.iterdir()
        if path.suffix in _DATA
    }
    total = hashlib.sha256()
    for path in sorted(modules | data):
        content = path.read_bytes().replace(b"\r\n", b"\n")
        name = path.relative_to(ROOT).as_posix()
        total.update(f"{name} {len(content)}\n".encode())
        total.update(content)
    return total.hexdigest()


class CodeVersion(BaseModel):
    """Identifies the code that runs trials.

    Attributes:
        source: digest of this project's modules that decide what a trial comes to.
        versions: versions of the packages that do.
        machine: kind of processor and numerical libraries. The same code gives the same bytes on
            the same kind; on another the last digits differ, which is no other code.
        revision: revision of the repository, for people: no comparison uses it, since many
            revisions have the same source.
    """

    model_config = ConfigDict(frozen=True, extra="forbid")

    source: str
    versions: dict[str, str]
    machine: str = ""
    revision: str = ""

    def differences(self, other: Self) -> list[str]:
        """Return ``name: this | other`` for each part that differs and can change a trial."""
        found = []
        if self.source != other.source:
            named = [f"{b.source[:12]} {b.revision}".strip() for b in (self, other)]
            found.append(f"source: {named[0]} | {named[1]}")
        packages = sorted({*self.versions, *other.versions})
        return found + [
            f"{name}: {self.versions.get(name, 'none')} | {other.versions.get(name, 'none')}"
            for name in packages
            if self.versions.get(name) != other.versions.get(name)
        ]

    def check(self, running: Self) -> None:
        """Refuse to run a trial by other code than the campaign's.

        Files may have been edited meanwhile, or a cluster's node may have another version.

        Raises:
            LabError: ``running`` differs from this version.
        """
        if changes := self.differences(running):
            raise LabError(
                "a worker runs other code than the campaign; undo edits made meanwhile, or bring "
                "all nodes to the same version, and give the same command again. Campaign | "
                "worker:\n  " + "\n  ".join(changes)
            )


@cache
def code_version(*modules: str, packages: tuple[str, ...] = PHYSICS) -> CodeVersion:
    """Return the version of the code that ``modules`` import, and of ``packages`` and Python."""
    versions = {"python": platform.python_version()} | package_versions(packages)
    return CodeVersion(
        source=digest(*modules), versions=versions, machine=machine(), revision=revision()
    )


@cache
def machine() -> str:
    """Return what decides the last digits of a result besides the code, in words.

    That is the instructions NumPy has found, the kernels OpenBLAS has chosen, which
    ``OPENBLAS_CORETYPE`` can change, the C library's version, and the project's own kernels in use.
    """
    simd: Any = np.show_config(mode="dicts")
    found = simd.get("SIMD Extensions", {}).get("found") or ["no extensions"]
    libc = " ".join(platform.libc_ver())
    blas = f"BLAS {_blas_kernels()}"
    parts = (f"{platform.machine()} {found[-1]}", blas, libc, native.summary())
    return "; ".join(part for part in parts if part)


def _blas_kernels() -> str:
    """Return the kernels that NumPy's own OpenBLAS has chosen, or ``unknown``."""
    for path in Path(np.__file__).parents[1].glob("numpy.libs/*openblas*"):
        with suppress(OSError):
            library = ctypes.CDLL(str(path))  # loaded already, by NumPy
            for name in ("scipy_openblas_get_corename64_", "openblas_get_corename"):
                if (ask := getattr(library, name, None)) is not None:
                    ask.restype = ctypes.c_char_p
                    return str(ask().decode())
    return "unknown"


def package_versions(packages: Sequence[str]) -> dict[str, str]:
    """Return the version of each of ``packages`` that is installed."""
    found = {}
    for package in packages:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


def environment() -> dict[str, str]:
    """Describe Python, machine, packages and revision, for the record of a run."""
    found = {
        "python": platform.python_version(),
        "platform": platform.platform(),
        "machine": machine(),
        "cpus": str(os.cpu_count()),
        **package_versions(PACKAGES),
    }
    commit = revision()
    return found | ({"commit": commit} if commit else {})


@cache
def revision() -> str:
    """Return the revision that is checked out, ``-dirty`` if changed; empty outside of a clone."""
    try:
        if Path(_git("rev-parse", "--show-toplevel")).resolve() != ROOT:
            return ""
        return _git("describe", "--always", "--dirty", "--abbrev=12", "--exclude=*")
    except (OSError, subprocess.SubprocessError):
        return ""


def _git(*arguments: str) -> str:
    done = subprocess.run(
        ["git", "-C", str(ROOT), *arguments],
        capture_output=True,
        text=True,
        check=True,
        timeout=_TIMEOUT,
    )
    return done.stdout.strip()
