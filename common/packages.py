"""Check that the packages of an optional part are installed and can be imported."""

import os
from importlib import import_module

from common.errors import ConfigError

_HARMLESS = {
    "MUJOCO_GL": ("", "egl", "disable", "disabled", "off", "false", "0"),
    "PYOPENGL_PLATFORM": ("", "egl"),
}
"""Variables that choose the OpenGL library, and their values that harm neither import nor EGL."""


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
    for package in packages:
        try:
            import_module(package)
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"{who} needs the package {error.name}: {install_hint(extra)}"
            ) from error
        except Exception as error:
            # Installed but broken: a library of the system may be missing, two versions mixed up
            # by an upgrade in place, or an OpenGL library chosen that is not there.
            hint = graphics_hint(*_HARMLESS) if package == "mujoco" else ""
            remedy = f"; {hint}" if hint else ""
            raise ConfigError(f"{who} cannot use the package {package}: {error}{remedy}") from error
