"""What is said of a package that is missing or broken."""

from pathlib import Path

import pytest

from common.errors import ConfigError
from deploy.extras import require


def test_what_is_there_is_no_matter() -> None:
    require("it", "sim", "json", "zenoh")


def test_a_missing_package_is_named_with_its_extra() -> None:
    with pytest.raises(ConfigError, match=r"it needs the package no_such: pip install '\.\[sim\]'"):
        require("it", "sim", "json", "no_such")


def test_a_broken_package_is_not_called_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "broken_one.py").write_text("raise ImportError('libGL.so.1: no such file')")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ConfigError, match="cannot use the package broken_one: libGL") as told:
        require("it", "sim", "broken_one")
    assert "pip" not in str(told.value)
