"""Compile the C kernels: as a hook of the package build, or in place with `python hatch_build.py`.

A kernel is a C file ``_name.c`` beside the Python module that uses it. It becomes an extension
module of the stable ABI, ``_name.abi3.so``, in the same folder. Kernels are optional: on a machine
without a C compiler the package is built without them, and the Python code does their work.
"""

import os
import runpy
import shlex
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parent
PACKAGES = ("common", "services")
SUFFIX = ".abi3.so"
# Neither the processor of the building machine nor the compiler's mood may change a bit of a
# result: no -march=native, no -ffast-math, no multiplication fused with an addition.
FLAGS = ("-std=c11", "-O3", "-ffp-contract=off", "-fPIC", "-shared", "-Wall", "-Wextra")


def sources() -> list[Path]:
    """Return the C files of all kernels."""
    return sorted(path for package in PACKAGES for path in (ROOT / package).rglob("_*.c"))


def find_compiler() -> list[str] | None:
    """Return the command of a C compiler that finds Python's headers; None: there is none.

    The environment variable ``CC`` chooses it.
    """
    own = sysconfig.get_config_var("CC") or "cc"
    candidates = [os.environ["CC"]] if os.environ.get("CC") else [own, "cc", "gcc", "clang"]
    for candidate in candidates:
        command = shlex.split(candidate)
        if command and shutil.which(command[0]) and _can_compile(command):
            return command
    return None


def _can_compile(compiler: list[str]) -> bool:
    """Return whether the compiler makes an extension module of nothing but Python's headers."""
    with tempfile.TemporaryDirectory() as folder:
        source = Path(folder) / "probe.c"
        source.write_text("#include <Python.h>\n#include <math.h>\n")
        done = _compile(compiler, source, Path(folder) / "probe.so")
    return done.returncode == 0


def _compile(
    compiler: list[str], source: Path, target: Path, *options: str
) -> subprocess.CompletedProcess[str]:
    include = sysconfig.get_path("include")
    # Python's own symbols are found in the process that loads the module.
    late = ["-undefined", "dynamic_lookup"] if sys.platform == "darwin" else []
    command = [*compiler, *FLAGS, *late, *options, f"-I{include}", f"-I{ROOT}", str(source)]
    return subprocess.run(
        [*command, "-o", str(target), "-lm"], capture_output=True, text=True, check=False
    )


def build(source: Path, compiler: list[str]) -> Path:
    """Compile one kernel beside its source and return the extension module.

    Raises:
        RuntimeError: the source does not compile.
    """
    # Shared with the loader, which refuses a module of another source; not importable here.
    fingerprint = runpy.run_path(str(ROOT / "common" / "native.py"))["fingerprint"](source)
    target = source.with_suffix(SUFFIX)
    # Replaced at once: a running process may have the old one mapped.
    partial = target.with_suffix(f".{os.getpid()}")
    done = _compile(compiler, source, partial, f'-DFINGERPRINT="{fingerprint}"')
    if done.stderr:
        print(done.stderr, end="", file=sys.stderr)
    if done.returncode != 0:
        partial.unlink(missing_ok=True)
        raise RuntimeError(f"{shlex.join(compiler)} cannot compile {source}; see above")
    partial.replace(target)
    return target


def build_all() -> list[Path]:
    """Compile all kernels in place and return the modules; none without a compiler.

    Raises:
        RuntimeError: there is a compiler, and a source does not compile.
    """
    found = sources()
    compiler = find_compiler() if found else None
    if found and compiler is None:
        print(
            "no C compiler that finds Python.h (CC, cc, gcc, clang): built without compiled "
            "kernels, which is slower and otherwise the same",
            file=sys.stderr,
        )
    return [] if compiler is None else [build(source, compiler) for source in found]


def get_build_hook() -> type:
    """Return the hook for the build backend, which is the only one to have its base class."""
    from hatchling.builders.hooks.plugin.interface import BuildHookInterface

    class KernelHook(BuildHookInterface):  # type: ignore[misc]
        """Builds the kernels in place, also for an editable install, and adds them to a wheel."""

        def initialize(self, version: str, build_data: dict[str, Any]) -> None:
            modules = build_all()
            if version == "editable" or not modules:
                return
            platform = sysconfig.get_platform().replace("-", "_").replace(".", "_")
            build_data["pure_python"] = False
            build_data["tag"] = f"cp311-abi3-{platform}"
            build_data["force_include"] |= {
                str(module): str(module.relative_to(ROOT)) for module in modules
            }

    return KernelHook


if __name__ == "__main__":
    for built in build_all():
        print(built.relative_to(ROOT))
