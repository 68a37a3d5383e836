"""Exceptions of the policies."""

from common.errors import TrillError


class PolicyError(TrillError):
    """Root of the policies' exceptions."""


class ProcessorError(PolicyError):
    """Arrays of a frame, an episode or an answer are not what the policy was made for."""


class CheckpointError(PolicyError):
    """A checkpoint cannot be written, or read, or is of another kind or schema."""
