"""Options that delay links: what is read, what is refused, and what a task's own link becomes."""

from pathlib import Path

import pytest

from common.errors import ConfigError
from common.links.config import Links
from common.links.spec import LinkSpec
from common.transport.config import BusConfig
from deploy.system import environment
from lab.trials.links import chosen_links, link_warnings, system_links


@pytest.fixture(autouse=True)
def _no_links_in_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("TRILL_LINKS", raising=False)
    monkeypatch.delenv("TRILL_CONFIG", raising=False)


def warnings(name: str, spec: str) -> list[str]:
    return link_warnings({name: LinkSpec.parse(spec)})


def test_options_and_files_become_the_variable(tmp_path: Path) -> None:
    path = tmp_path / "links.toml"
    path.write_text(
        "[links]\ncommand = '250ms'\n[links.'wbc:plant/state']\nmean = 0.02\nloss = 0.01\n"
    )
    options = [str(path), "camera=normal(122ms, 190ms) loss=1% seed=7", "command=40ms"]
    links = Links.from_variable(system_links(options, {}, None))
    assert str(links.of("wbc", "teleop/gait")) == "40ms"
    assert str(links.of("wbc", "plant/state")) == "20ms loss=1%"
    assert str(links.of("teleop", "camera/left")) == "normal(122ms, 190ms) loss=1% seed=7"


def test_none_stands_alone() -> None:
    assert chosen_links([]) is None
    assert chosen_links(["none"]) == {}
    assert chosen_links(["both=1ms", "command=2ms"]) == {"both": "1ms", "command": "2ms"}
    with pytest.raises(ConfigError, match="both=1ms"):
        chosen_links(["none", "both=1ms"])


def test_a_semicolon_would_end_a_link_of_the_variable(tmp_path: Path) -> None:
    path = tmp_path / "a;b.csv"
    path.write_text("1ms\n")
    with pytest.raises(ConfigError, match="';'"):
        chosen_links([f"command=trace({path})"])


def test_latency_goes_to_the_services_over_what_is_there(monkeypatch: pytest.MonkeyPatch) -> None:
    assert system_links(["command=1ms"], {}, None) == "command=1ms"
    monkeypatch.setenv("TRILL_LINKS", "wbc:teleop/gait=5ms; camera=6ms")
    both = system_links(["command=250ms"], {}, None)
    assert environment(BusConfig(), None, both)["TRILL_LINKS"] == both
    links = Links.from_variable(both)
    assert str(links.of("wbc", "teleop/gait")) == "250ms"
    assert str(links.of("keyboard", "camera/left")) == "6ms"
    assert "TRILL_LINKS" not in environment(BusConfig(), None)


def test_a_tasks_own_link_holds_unless_links_are_given(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = {"command": "paper"}
    bare, with_links = tmp_path / "bare.toml", tmp_path / "links.toml"
    bare.write_text("[wbc]\npace = 'fast'\n")
    with_links.write_text("[links]\ncamera = '1ms'\n")

    assert system_links([], own, None) == system_links([], own, bare) == "command=paper"
    assert "command=paper; --latency none switches it off" in capsys.readouterr().out
    assert system_links(["none"], own, None) == ""
    assert "switched off" in capsys.readouterr().out
    assert system_links(["camera=5ms"], own, None) == "camera=5ms"
    assert system_links([], own, with_links) == ""
    monkeypatch.setenv("TRILL_CONFIG", str(with_links))
    assert system_links([], own, None) == ""
    monkeypatch.setenv("TRILL_CONFIG", str(bare))
    monkeypatch.setenv("TRILL_LINKS", "camera=2ms")
    assert system_links([], own, None) == ""
    said = capsys.readouterr().out
    assert said.count("replaced by the links given") == 4

    monkeypatch.delenv("TRILL_LINKS")
    assert system_links([], {}, None) == system_links(["none"], {}, None) == ""
    assert system_links(["camera=5ms"], {}, None) == "camera=5ms"
    assert capsys.readouterr().out == ""


def test_warnings_name_the_worst_rate_and_the_guard() -> None:
    assert warnings("command", "250ms") == warnings("camera", "20ms") == []
    (wide,) = warnings("both", "normal(122ms, 190ms)")
    assert wide.startswith("both: at 200 Hz the mean will be")
    (guard,) = warnings("wbc/command", "50ms")
    assert "older than 0.1 s" in guard
    assert warnings("wbc/command", "0") == []
    with pytest.raises(ConfigError):
        warnings("nothing", "1ms")
