"""Define the root of every exception of this project; put validation errors in words."""

import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pydantic import ValidationError

EXIT_WRONG_CONFIGURATION = 2
"""Exit code of a program whose configuration or options are wrong."""
EXIT_NAME_TAKEN = 4
"""Exit code of a service that is running already."""
EXITS_FOR_GOOD = frozenset({EXIT_WRONG_CONFIGURATION, EXIT_NAME_TAKEN})
"""Exit codes of programs that would end so again; they are not started once more."""

_LONGEST_VALUE = 60
"""Characters shown of a refused value."""


class TrillError(Exception):
    """Root exception; its message says what happened, what was expected and got, and the remedy."""


class SchemaError(TrillError):
    """A message does not fit its schema (wrong field, shape, dtype, range or non-finite value)."""


class ConfigError(TrillError):
    """A configuration file or option is wrong."""


def report(program: str, error: TrillError) -> int:
    """Print the error with which ``program`` ends; return its exit code.

    The code is :data:`EXIT_WRONG_CONFIGURATION`, or 1 for any other error.
    """
    print(f"{program}: {error}", file=sys.stderr)
    return EXIT_WRONG_CONFIGURATION if isinstance(error, ConfigError) else 1


def explain(error: "ValidationError") -> str:
    """Return one line ``key.path: what was expected (got …)`` for each wrong value of ``error``."""
    return "\n".join(
        _line(".".join(str(part) for part in item["loc"]), item["type"], item["msg"], item["input"])
        for item in error.errors(include_url=False, include_context=False)
    )


def _line(path: str, kind: str, message: str, value: object) -> str:
    """Describe one wrong value; ``path`` is empty if the fault is in the whole table."""
    if kind == "missing":
        return f"{path}: not given"
    if kind == "extra_forbidden":
        return f"{path}: no such key"
    # Validators of this project name the value themselves.
    text = message.removeprefix("Value error, ")
    where = f"{path}: " if path else ""
    if text != message or isinstance(value, dict):
        return where + text
    got = repr(value)
    shown = got if len(got) <= _LONGEST_VALUE else got[:_LONGEST_VALUE] + "…"
    return f"{where}{text} (got {shown})"
