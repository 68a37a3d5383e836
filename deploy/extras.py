"""Check that the packages of an optional part are installed."""

from importlib import import_module

from common.errors import ConfigError


def install_hint(extra: str) -> str:
    """Return the command that installs an optional dependency of this project."""
    return f"pip install '.[{extra}]' in a checkout of trill"


def require(who: str, extra: str, *packages: str) -> None:
    """Check that the ``packages`` of ``extra``, which ``who`` needs, can be imported.

    Raises:
        ConfigError: a package is missing or broken; the message names the extra.
    """
    for package in packages:
        try:
            import_module(package)
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"{who} needs the package {error.name}: {install_hint(extra)}"
            ) from error
        except ImportError as error:
            # Installed but broken: a library of the system may be missing.
            raise ConfigError(f"{who} cannot use the package {package}: {error}") from error
