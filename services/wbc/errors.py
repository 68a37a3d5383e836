"""Exceptions of the whole-body controller."""

from common.errors import TrillError


class WbcError(TrillError):
    """Root of the controller's exceptions."""


class ModelError(WbcError):
    """The robot model is not the one the controller was written for."""


class SolverUnavailableError(WbcError):
    """The configured QP solver is not installed or not known."""
