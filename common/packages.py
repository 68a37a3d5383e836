"""Check that the packages of an optional part are installed and can be imported."""

import os
from collections.abc import Iterator
from contextlib import contextmanager
from importlib import import_module
from pathlib import Path
from traceback import extract_tb

from common.errors import ConfigError, report

_HARMLESS = {
    "MUJOCO_GL": ("", "egl", "disable", "disabled", "off", "false", "0"),
    "PYOPENGL_PLATFORM": ("", "egl"),
}
"""Variables that choose the OpenGL library, and their values that harm neither import nor EGL."""

_IMPORT_ERRORS = (ImportError, AttributeError, RuntimeError, OSError)
"""What packages raise on import that lack a library or are mixed up of two versions."""


def install_hint(extra: str) -> str:
    """Return the command that installs an optional dependency of this project."""
    return f"pip install '.[{extra}]' in a checkout of trill"


def graphics_hint(*names: str) -> str:
    """Say which of these variables chooses an OpenGL library other than EGL; empty: none.

    Args:
        names: ``MUJOCO_GL``, which MuJoCo's import obeys; ``PYOPENGL_PLATFORM``, which rendering
            obeys too.
    """
    values = {name: os.environ.get(name, "") for name in names}
    wrong = [f"{n}={v}" for n, v in values.items() if v.lower().strip() not in _HARMLESS[n]]
    if not wrong:
        return ""
    return f"unset {' and '.join(wrong)}; pictures are rendered through EGL in any case"


def require(who: str, extra: str, *packages: str) -> None:
    """Check that the ``packages`` of ``extra``, which ``who`` needs, can be imported.

    Raises:
        ConfigError: a package is missing or broken; the message names the extra, and variables
            that are known to break its import.
    """
    # Before the import, which may set such a variable itself.
    hint = graphics_hint(*_HARMLESS)
    for package in packages:
        try:
            import_module(package)
        except Exception as error:
            raise ConfigError(f"{who} {_explain(extra, error, hint)}") from error


@contextmanager
def imports_of(who: str, extra: str) -> Iterator[None]:
    """Import the modules of a program, or end it in words.

    For main modules, whose imports come before anything that could report an error.

    Raises:
        SystemExit: with code 2, after a message that says which package is missing or broken.
    """
    hint = graphics_hint(*_HARMLESS)
    try:
        yield
    except _IMPORT_ERRORS as error:
        raise SystemExit(report(who, ConfigError(_explain(extra, error, hint)))) from error


def _explain(extra: str, error: Exception, hint: str) -> str:
    """Say which package is missing or broken; ``hint`` is for MuJoCo's."""
    if isinstance(error, ModuleNotFoundError):
        return f"needs the package {error.name}: {install_hint(extra)}"
    # Installed but broken: a library of the system may be missing, two versions mixed up by an
    # upgrade in place, or an OpenGL library chosen that is not there.
    frames = extract_tb(error.__traceback__)
    in_mujoco = any("mujoco" in Path(frame.filename).parts[-3:] for frame in frames)
    text = f"cannot use a package of its extra {extra}: {type(error).__name__}: {error}"
    return f"{text}; {hint}" if hint and in_mujoco else text
