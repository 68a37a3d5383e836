"""Which code it is: a digest of the modules that decide what a trial comes to, and versions."""

import ast
import hashlib
import subprocess
from collections.abc import Sequence
from contextlib import suppress
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
_WALKED = ("services.sim.tasks",)
"""Packages whose modules are found by walking, not by an import statement."""
_DATA = {".xml", ".json", ".toml", ".npy", ".npz", ".stl", ".obj", ".png"}
_PATIENCE = 10.0
PHYSICS = ("mujoco", "pin", "osqp", "daqp", "scipy", "numpy")
"""Packages whose versions can change what the robot does."""


def _file(module: str) -> Path | None:
    base = ROOT.joinpath(*module.split("."))
    candidates = (base.with_suffix(".py"), base / "__init__.py")
    return next((path for path in candidates if path.is_file()), None)


def _imported(path: Path) -> set[str]:
    """Every name that an import statement in ``path`` may mean as a module."""
    names: set[str] = set()
    for node in ast.walk(ast.parse(path.read_bytes())):
        if isinstance(node, ast.Import):
            names.update(alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module and not node.level:
            names.add(node.module)
            names.update(f"{node.module}.{alias.name}" for alias in node.names)
    return names


def closure(*roots: str) -> dict[str, Path]:
    """Modules of this project that ``roots`` import, directly or not, with their files."""
    todo = list(roots)
    for package in _WALKED:
        folder = ROOT.joinpath(*package.split("."))
        todo += [
            ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in folder.rglob("*.py")
        ]
    found: dict[str, Path] = {}
    while todo:
        module = todo.pop().removesuffix(".__init__")
        path = _file(module)
        if path is None or module in found:
            continue
        found[module] = path
        todo += _imported(path)
        if "." in module:
            todo.append(module.rpartition(".")[0])
    return found


@cache
def digest(root: str) -> str:
    """SHA-256 over the files of :func:`closure` and the data beside them, the same everywhere.

    Line ends do not count, nor where the project lies, nor any of its other modules.
    """
    modules = set(closure(root).values())
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


def package_versions(packages: Sequence[str]) -> dict[str, str]:
    """Version of each of ``packages`` that is installed."""
    found = {}
    for package in packages:
        with suppress(PackageNotFoundError):
            found[package] = version(package)
    return found


@cache
def revision() -> str:
    """Git's name of what is checked out, ``-dirty`` if changed since; empty: no clone of ours."""
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
        timeout=_PATIENCE,
    )
    return done.stdout.strip()
