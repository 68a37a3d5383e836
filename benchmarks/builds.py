"""Builds of this project to be compared with each other: directories with their own sources."""

import os
import resource
import subprocess
import sys
import time
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

OWN_ROOT = Path(__file__).resolve().parents[1]


class Cost(NamedTuple):
    """Time of one run of a command [s]."""

    elapsed: float
    cpu: float


def _children_cpu() -> float:
    """Return the processor time of all children that have ended [s]."""
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


@dataclass(frozen=True)
class Build:
    """A source tree, run by this interpreter with its installed packages.

    Attributes:
        name: how tables call it.
        root: the directory that holds ``pyproject.toml`` and the packages.
    """

    name: str
    root: Path

    @property
    def environment(self) -> dict[str, str]:
        """Variables under which a Python process imports this tree and no other."""
        return os.environ | {"PYTHONPATH": str(self.root)}

    def has(self, module: str) -> bool:
        """Whether the tree has the source file of ``module``."""
        path = self.root.joinpath(*module.split("."))
        return path.with_suffix(".py").is_file() or (path / "__init__.py").is_file()

    def command(self, *arguments: str) -> list[str]:
        """Return the command line of ``trill`` with ``arguments``, without a console script."""
        project = tomllib.loads((self.root / "pyproject.toml").read_text(encoding="utf-8"))
        module, _, function = project["project"]["scripts"]["trill"].partition(":")
        code = f"import sys; from {module} import {function}; sys.exit({function}())"
        return [sys.executable, "-c", code, *arguments]

    def cost(self, command: list[str], folder: Path) -> Cost:
        """Run ``command`` in ``folder`` and return what it took.

        Raises:
            CalledProcessError: it fails.
        """
        start, used = time.perf_counter(), _children_cpu()
        subprocess.run(
            command, env=self.environment, cwd=folder, stdout=subprocess.DEVNULL, check=True
        )
        return Cost(time.perf_counter() - start, _children_cpu() - used)


def own_and(other: Path | None) -> list[Build]:
    """Return this tree and, if there is one, the tree to compare it with."""
    builds = [Build("ours", OWN_ROOT)]
    return builds if other is None else [*builds, Build("against", other.resolve())]
