"""``trill teleop`` and ``trill up --teleop``: what they start, and how they refuse."""

from pathlib import Path

import pytest

pytest.importorskip("aiohttp")
pytest.importorskip("segno")
pytest.importorskip("cryptography")

from deploy.process import ProcessSpec
from lab.cli.main import main


@pytest.fixture
def started(monkeypatch: pytest.MonkeyPatch) -> list[list[str]]:
    calls: list[list[str]] = []

    def note(options: list[str]) -> int:
        calls.append(options)
        return 0

    monkeypatch.setattr("services.teleop.__main__.main", note)
    return calls


def test_options_reach_the_operator(started: list[list[str]]) -> None:
    assert main(["teleop"]) == 0
    assert main(["teleop", "--lan", "--port", "9443", "--new-token", "--base-port", "7464"]) == 0
    assert main(["teleop", "--connect", "tcp/robot:7447,tcp/other:7447"]) == 0
    assert started == [
        ["headset"],
        ["headset", "--base-port", "7464", "--port", "9443", "--lan", "--new-token"],
        ["headset", "--mode", "client", "--connect", "tcp/robot:7447,tcp/other:7447"],
    ]


def test_a_wrong_option_is_refused_before_anything_is_served(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text("[headset]\npages = 0\n")
    assert main(["teleop", "--config", str(settings)]) == 2
    assert "pages" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("given", "scheme", "args"), [("web", "http", ()), ("lan", "https", ("--lan",))]
)
def test_up_prints_the_link_and_starts_the_operator(
    given: str,
    scheme: str,
    args: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(f'[headset]\nport = 9443\nfolder = "{tmp_path / "data"}"\n')
    seen: list[list[ProcessSpec]] = []

    def run_up(_options: object, _port: object, operators: list[ProcessSpec]) -> object:
        seen.append(operators)
        raise KeyboardInterrupt

    monkeypatch.setattr("lab.live.drive.run_up", run_up)
    assert main(["up", "--teleop", given, "--config", str(settings)]) == 130
    token = (tmp_path / "data" / "token").read_text().strip()
    printed = capsys.readouterr().out
    assert f"open {scheme}://" in printed
    assert f":9443/#{token}" in printed
    (operators,) = seen
    assert [(o.name, o.args) for o in operators] == [("headset", ("headset", *args))]
