"""Exceptions of the operator inputs."""

from common.errors import TrillError


class TeleopError(TrillError):
    """Root of the operator inputs' exceptions."""


class ScriptError(TeleopError):
    """A script cannot continue; the message is the reason shown to the user."""


class TerminalError(TeleopError):
    """The keyboard operator has no terminal to read from."""
