"""What a program imports before it does anything: it is what its users wait for."""

import os
import subprocess
import sys

import pytest

COMMON = {
    "annotated_types",
    "msgpack",
    "numpy",
    "pydantic",
    "pydantic_core",
    "typing_extensions",
    "typing_inspection",
    "zenoh",
}
OWN = {"common", "deploy", "lab", "services"}
PROGRAMS = {
    "services.sim.__main__": COMMON | {"mujoco"},
    "services.sim.rendering.cameras": COMMON | {"cv2", "mujoco"},
    "services.wbc.__main__": COMMON
    | {"coal", "eigenpy", "jinja2", "markupsafe", "osqp", "pinocchio", "scipy"},
    "services.teleop.__main__": COMMON,
    "services.logger.__main__": COMMON | {"lz4", "mcap", "zstandard"},
    "deploy.router": COMMON - {"msgpack", "numpy"},
    "lab.cli.main": set[str](),
}
"""Third-party packages that each program may import at its start."""


def imported_by(module: str) -> set[str]:
    """Names of the modules that a fresh interpreter imports for ``module``."""
    code = (
        "import sys\n"
        "before = set(sys.modules)\n"
        f"import {module}\n"
        "print(*(set(sys.modules) - before))"
    )
    # The tests' own choice of a renderer is not the service's.
    environment = {name: text for name, text in os.environ.items() if name != "MUJOCO_GL"}
    done = subprocess.run(
        [sys.executable, "-c", code], env=environment, capture_output=True, text=True, check=True
    )
    return set(done.stdout.split())


@pytest.mark.parametrize("module", PROGRAMS)
def test_nothing_is_imported_that_the_start_does_not_need(module: str) -> None:
    modules = imported_by(module)
    assert module in modules
    packages = {name.partition(".")[0] for name in modules} - sys.stdlib_module_names - OWN
    packages = {name for name in packages if not name.startswith(("_", "cython_runtime"))}
    assert packages <= PROGRAMS[module]
    # OSQP takes SciPy's sparse matrices; every other part of SciPy is slow to import.
    scipy = {name for name in modules if name.startswith("scipy.") and name.count(".") == 1}
    public = {name for name in scipy if not name.startswith("scipy._")}
    assert public <= {"scipy.sparse", "scipy.version"}


def test_trill_imports_its_subcommands_only_when_they_are_chosen() -> None:
    modules = imported_by("lab.cli.main")
    own = {name for name in modules if name.partition(".")[0] in OWN}
    assert own == {
        "common",
        "common.errors",
        "common.program",
        "lab",
        "lab.cli",
        "lab.cli.commands",
        "lab.cli.main",
    }
