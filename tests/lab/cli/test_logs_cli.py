"""trill info, repair and record as a person types them."""

import json
import os
from pathlib import Path

import pytest

from lab.cli.main import main
from tests.services.logger.support import END, START, gait, link, mark, picture, record


@pytest.fixture
def run(tmp_path: Path) -> Path:
    samples = [gait(seq, at=10**9 + 10**8 * seq) for seq in (0, 1, 2, 5)]
    samples += [
        picture(3),
        mark(0, 0, START, 11 * 10**8, "open the door"),
        mark(1, 0, END, 12 * 10**8),
    ]
    samples += [link(0, 13 * 10**8)]
    record(tmp_path / "log.mcap", samples)
    return tmp_path


def test_info(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["info", str(run)]) == 0
    text = capsys.readouterr().out
    for part in (
        "robot      draco3, recorded on",
        "whole",
        "draco3/camera/left",
        "GaitRequest/1",
        "sent 10 = recorded 8 + lost on the way 2 + dropped by the logger 0",
        "complete    open the door",
        "wbc:teleop/setpoint = 250ms request",
        "3 sent before the recorder could hear",
    ):
        assert part in text
    assert main(["info", str(run / "log.mcap"), "--json"]) == 0
    info = json.loads(capsys.readouterr().out)
    assert info["whole"]
    assert info["episodes"][0]["label"] == "open the door"
    assert sum(topic["sent"] for topic in info["topics"]) == 10


def test_repair(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    log = run / "log.mcap"
    assert main(["repair", str(run)]) == 0
    assert "is whole; nothing was changed" in capsys.readouterr().out
    log.write_bytes(log.read_bytes()[:-500])
    assert main(["info", str(run)]) == 0
    assert "CUT OFF OR DAMAGED: trill repair saves it" in capsys.readouterr().out
    assert main(["repair", str(run), "--out", str(run / "saved.mcap")]) == 0
    assert "its end is missing" in capsys.readouterr().out
    assert main(["repair", str(run)]) == 0
    text = capsys.readouterr().out
    assert "saved 8 messages" in text
    assert "the broken file is kept as" in text
    assert "10 sent, 2 of them missing" in text


def test_what_is_no_log(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "log.mcap").write_text("no log")
    assert main(["repair", str(tmp_path)]) == 1
    assert "nothing in it can be read as an MCAP log" in capsys.readouterr().err
    assert main(["info", str(tmp_path)]) == 1
    assert "not an MCAP log" in capsys.readouterr().err


def test_record_hands_its_options_on(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started: list[list[str]] = []
    monkeypatch.setattr(os, "execv", lambda _path, words: started.append(words[3:]))
    words = ["--connect", "tcp/robot:7448", "--no-cameras", "--rotate-size", "2GB"]
    main(["record", "--out", str(tmp_path), *words])
    (given,) = started
    for pair in (
        ["--connect", "tcp/robot:7448"],
        ["--mode", "client"],
        ["--rotate-size", "2GB"],
        ["--out", str(tmp_path)],
    ):
        assert given[given.index(pair[0]) : given.index(pair[0]) + 2] == pair
    assert "--no-cameras" in given


def test_wrong_options_leave_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert main(["record", "--rotate-size", "two"]) == 2
    assert "'two' is not a size" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []
