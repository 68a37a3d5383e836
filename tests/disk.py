"""A disk that is full."""

import pytest


def fill(monkeypatch: pytest.MonkeyPatch) -> None:
    """From now on no file reaches the disk."""

    def full(_descriptor: int) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("os.fsync", full)
