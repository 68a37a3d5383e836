"""Exceptions of the operator inputs."""

from common.errors import TrillError


class TeleopError(TrillError):
    """Root of what an operator input raises."""


class ScriptError(TeleopError):
    """A script cannot go on; the message is the reason shown to the user."""


class TerminalError(TeleopError):
    """The keyboard operator has no terminal to read from."""
