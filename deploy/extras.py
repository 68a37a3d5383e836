"""Packages of the optional parts, which may not be installed."""

from importlib import import_module

from common.errors import ConfigError


def require(who: str, extra: str, *packages: str) -> None:
    """Be sure that ``packages`` can be imported.

    Args:
        who: needs them, for the message.
        extra: of this project's, that brings them.
        packages: by the names they are imported under.

    Raises:
        ConfigError: one cannot.
    """
    for package in packages:
        try:
            import_module(package)
        except ModuleNotFoundError as error:
            raise ConfigError(
                f"{who} needs the package {error.name}: pip install 'trill[{extra}]' (or -e "
                f"'.[{extra}]' in a checkout)"
            ) from error
        except ImportError as error:
            # There, but broken: a library of the system's may be missing.
            raise ConfigError(f"{who} cannot use the package {package}: {error}") from error
