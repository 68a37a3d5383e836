"""Load compiled kernels: C code that does what Python code beside it does, faster.

A kernel is optional. Whoever has one keeps the Python code, which says what is right and is used
where the kernel is not built (see ``hatch_build.py``) or the environment sets ``TRILL_NATIVE=0``.
"""

import hashlib
import logging
import os
from importlib import import_module
from pathlib import Path
from types import ModuleType

VARIABLE = "TRILL_NATIVE"
"""Environment variable; 0: no kernels."""
_PACKAGES = ("common", "services")
_ROOT = Path(__file__).resolve().parents[1]
_LOG = logging.getLogger(__name__)


def fingerprint(source: Path) -> str:
    """Return what a module built from the C file ``source`` calls itself, in ``FINGERPRINT``."""
    header = Path(__file__).with_suffix(".h")
    return hashlib.sha256(header.read_bytes() + source.read_bytes()).hexdigest()[:16]


def kernel(name: str) -> ModuleType | None:
    """Return the compiled kernel ``name``, e.g. ``services.sim.physics._steps``; None: use Python.

    A module that was built from another version of its source is not used, with a warning.

    Raises:
        ImportError: it is built, but not for this machine.
    """
    if os.environ.get(VARIABLE) == "0":
        return None
    try:
        module = import_module(name)
    except ModuleNotFoundError as error:
        if error.name != name:
            raise
        return None
    source = _ROOT.joinpath(*name.split(".")).with_suffix(".c")
    if source.is_file() and fingerprint(source) != module.FINGERPRINT:
        _LOG.warning(
            "%s is not built from the present %s: build it again with `python "
            "hatch_build.py`; using Python",
            module.__file__,
            source.name,
        )
        return None
    return module


def kernels() -> dict[str, bool]:
    """Return whether each kernel of this installation is in use, by name."""
    sources = (path for package in _PACKAGES for path in (_ROOT / package).rglob("_*.c"))
    names = sorted(".".join(path.relative_to(_ROOT).with_suffix("").parts) for path in sources)
    return {name: kernel(name) is not None for name in names}


def summary() -> str:
    """Say in a few words which kernels are in use."""
    found = kernels()
    if all(found.values()):
        return f"{len(found)} compiled kernels"
    if not any(found.values()):
        why = f"{VARIABLE}=0" if os.environ.get(VARIABLE) == "0" else "not built"
        return f"no compiled kernels ({why})"
    missing = ", ".join(name for name, is_used in found.items() if not is_used)
    return f"{sum(found.values())} compiled kernels, without {missing}"
