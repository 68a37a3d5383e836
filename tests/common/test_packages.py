"""What is said of a package that is missing or broken."""

import sys
from importlib import import_module
from pathlib import Path

import pytest

from common.errors import ConfigError
from common.packages import imports_of, require


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
    with pytest.raises(
        ConfigError, match="it cannot use a package of its extra sim: ImportError: libGL"
    ) as told:
        require("it", "sim", "broken_one")
    assert "pip" not in str(told.value)


def test_a_variable_that_breaks_the_import_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # What `import mujoco` does with MUJOCO_GL=osmesa where OSMesa is not installed.
    (tmp_path / "mujoco").mkdir()
    (tmp_path / "mujoco" / "__init__.py").write_text("None.glGetError")
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "mujoco", raising=False)
    monkeypatch.setenv("MUJOCO_GL", "osmesa")
    monkeypatch.setenv("PYOPENGL_PLATFORM", "egl")
    with pytest.raises(ConfigError, match="unset MUJOCO_GL=osmesa;") as told:
        require("it", "sim", "mujoco")
    assert "PYOPENGL_PLATFORM" not in str(told.value)
    monkeypatch.delenv("MUJOCO_GL")
    with pytest.raises(ConfigError) as told:
        require("it", "sim", "mujoco")
    assert "unset" not in str(told.value)


@pytest.mark.parametrize(
    ("content", "words"),
    [(None, "needs the package not_there"), ("raise ImportError('two versions')", "two versions")],
)
def test_a_program_whose_packages_are_not_right_ends_in_words(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    content: str | None,
    words: str,
) -> None:
    if content is not None:
        (tmp_path / "not_there.py").write_text(content)
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(SystemExit) as end, imports_of("services.sim", "sim"):
        import_module("not_there")
    assert end.value.code == 2
    told = capsys.readouterr().err
    assert told.startswith("services.sim: ")
    assert words in told
