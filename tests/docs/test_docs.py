"""The documentation is true: links lead somewhere, commands exist, generated pages are current."""

import re
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from pydantic import BaseModel

import docs.reference
from common.transport.config import read_config_file
from docs.reference.configuration import INTRODUCTION, TABLES, covered
from docs.reference.fields import description_of, nested_models
from lab.cli.main import main

from .pages import (
    ROOT,
    Broken,
    anchors,
    broken_links,
    files,
    make_targets,
    modules,
    pages,
    subcommands,
    trill_options,
)

PAGES = pages()
NAMES = [str(page.relative_to(ROOT)) for page in PAGES]
EXAMPLES = {"services.battery", "tests/services/test_battery.py"}
"""What a reader of a how-to is to make."""
NESTED = {"latency", "dataset", "study"}
"""Subcommands of ``trill`` that have subcommands."""


@pytest.fixture(params=PAGES, ids=NAMES)
def page(request: pytest.FixtureRequest) -> Path:
    return Path(request.param)


@pytest.fixture
def text(page: Path) -> str:
    return page.read_text(encoding="utf-8")


def test_generated_pages_are_up_to_date() -> None:
    assert docs.reference.outdated() == [], "run `make docs`"


def test_an_outdated_page_is_noticed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(docs.reference, "FOLDER", tmp_path)
    docs.reference.write()
    assert docs.reference.outdated() == []
    (tmp_path / "topics.md").write_text("old\n")
    (tmp_path / "configuration.md").unlink()
    assert docs.reference.outdated() == ["configuration.md", "topics.md"]


def test_links_and_images_lead_somewhere(page: Path) -> None:
    assert broken_links(page) == []


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("[a](missing.md)", "no such file"),
        ("![a](missing.jpg)", "no such file"),
        ("[a](there.md#nowhere)", "no such heading"),
        ("[a](#nowhere)", "no such heading"),
        ("[a](../../../outside.md)", "no such file"),
        ("[![a](missing.jpg)](there.md)", "no such file"),
        ('<img src="missing.jpg">', "no such file"),
        ("[a][b]\n\n[b]: missing.md", "no such file"),
    ],
)
def test_a_broken_link_is_noticed(tmp_path: Path, line: str, reason: str) -> None:
    (tmp_path / "there.md").write_text("# There it is\n")
    page = tmp_path / "page.md"
    page.write_text(
        f"# Page\n[good](there.md#there-it-is), [here](#page), `[code](none.md)`\n{line}\n"
    )
    assert [broken.reason for broken in broken_links(page, tmp_path)] == [reason]


def test_a_broken_link_in_the_readme_is_noticed(tmp_path: Path) -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    link = "(docs/how-to/drive.md)"
    assert link in readme
    (tmp_path / "README.md").write_text(readme.replace(link, "(docs/how-to/dirve.md)", 1))
    for name in ("docs", "tests", "LICENSE", "NOTICE", "CITATION.cff"):
        (tmp_path / name).symlink_to(ROOT / name)
    broken = broken_links(tmp_path / "README.md", tmp_path)
    assert Broken("README.md", "docs/how-to/dirve.md", "no such file") in broken


def test_anchors_are_those_of_forges() -> None:
    text = "# A `b`: c, d\n## Twice\n```\n# code\n```\n## Twice\n### [Link](x.md) – end\n"
    assert anchors(text) == {"a-b-c-d", "twice", "twice-1", "link--end"}


def test_modules_can_be_imported(text: str) -> None:
    named = modules(text) - EXAMPLES
    assert [name for name in sorted(named) if find_spec(name) is None] == []


def test_files_in_commands_exist(text: str) -> None:
    named = files(text) - EXAMPLES
    assert [name for name in sorted(named) if not (ROOT / name).exists()] == []


def test_make_targets_exist(text: str) -> None:
    known = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert make_targets(text) <= known


def test_subcommands_of_trill_exist(text: str) -> None:
    for words in sorted(subcommands(text)):
        command = list(words[: 2 if words[0] in NESTED else 1])
        with pytest.raises(SystemExit) as ended:
            main([*command, "--help"])
        assert ended.value.code == 0, f"trill {' '.join(command)}"


def test_options_of_trill_exist(text: str, capsys: pytest.CaptureFixture[str]) -> None:
    for line, options in trill_options(text):
        words = line.split()
        command = words[: 2 if words[0] in NESTED else 1]
        with pytest.raises(SystemExit):
            main([*command, "--help"])
        known = set(re.findall(r"--[a-z][a-z-]*", capsys.readouterr().out))
        assert options - known == set(), line


def test_what_pages_mention_is_found() -> None:
    text = "Run `make demo`, `trill study tlx --x` or\n```sh\ntrill up\nA=b trill top --ledger\n"
    text += "python -m services.wbc --help\nmake test ARGS=1\npython benchmarks/bench_bus.py\n```\n"
    assert make_targets(text) == {"demo", "test"}
    assert subcommands(text) == {("study", "tlx"), ("up",), ("top",)}
    assert modules(text) == {"services.wbc"}
    assert files(text) == {"benchmarks/bench_bus.py"}
    assert list(trill_options(text)) == [("up", set()), ("top --ledger", {"--ledger"})]


def test_the_example_configuration_is_accepted(tmp_path: Path) -> None:
    match = re.search(r"```toml\n(.*?)```", INTRODUCTION, re.DOTALL)
    assert match is not None
    path = tmp_path / "stack.toml"
    path.write_text(match[1])
    tables = read_config_file(path)
    presets = {"torque_mode", "pace"}
    for table in TABLES:
        if table.name in tables and table.name != "links":
            values = tables[table.name]
            if table.name == "wbc":
                values = {key: value for key, value in values.items() if key not in presets}
            table.models[0].model_validate(values)


def test_every_configuration_model_is_in_the_reference() -> None:
    named = {model.__name__ for model in _all_models() if model.__name__.endswith("Config")}
    assert named - {model.__name__ for model in covered()} == set()


def test_every_key_is_explained() -> None:
    bare = {
        f"{model.__name__}.{name}"
        for model in covered()
        for name, field in model.model_fields.items()
        if not description_of(model, name) and not list(nested_models(field.annotation))
    }
    assert bare == set()


def _all_models() -> set[type[BaseModel]]:
    """Configuration models of services and of what they share, as far as imported here."""
    found: set[type[BaseModel]] = set()
    pending: list[type[BaseModel]] = [BaseModel]
    while pending:
        for model in pending.pop().__subclasses__():
            if model not in found:
                found.add(model)
                pending.append(model)
    rooms = ("common.", "services.")
    return {
        model
        for model in found
        if model.__module__.startswith(rooms)
        and model.__module__ in sys.modules
        and not model.__name__.startswith("_")
    }
