"""``trill export`` and ``trill view`` as a person meets them."""

import argparse
import sys
from pathlib import Path

import pytest

from lab.cli.export import EXPORT_ACTION
from lab.cli.logs import RECORD_ACTION
from lab.cli.main import main
from lab.cli.replay import ACTION as REPLAY
from services.logger.__main__ import settings_of
from tests.services.logger.export_support import read, session, write


def test_a_run_is_exported_beside_its_log(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write(tmp_path / "log.mcap", session())
    assert main(["export", str(tmp_path)]) == 0
    found = read(tmp_path / "log-exported.mcap")
    lines = capsys.readouterr().out.splitlines()
    counts = {line.split()[0]: int(line.split()[1]) for line in lines if line.startswith("  /")}
    assert counts == {topic: len(messages) for topic, messages in found.items()}
    assert f"{len(session())} messages of 8 topics over 0.1 s became" in "\n".join(lines)


def test_what_is_left_out_is_printed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path / "log.mcap", session())
    arguments = ["export", str(tmp_path / "log.mcap"), "-o", str(tmp_path / "o.mcap")]
    assert main([*arguments, "--topics", "camera/*"]) == 0
    text = capsys.readouterr().out
    assert "left out       plant/state: 20 messages: not among --topics" in text
    assert main(arguments) == 1
    assert "exists already; give another -o, or --force" in capsys.readouterr().err
    assert main([*arguments, "--force"]) == 0


@pytest.mark.parametrize(
    "patterns", ["camera/*,wbc/reply", "camera/* wbc/reply", "camera/*, wbc/reply"]
)
def test_topics_are_separated_by_commas_or_blanks_and_take_no_log(
    tmp_path: Path, patterns: str
) -> None:
    write(tmp_path / "log.mcap", session())
    assert main(["export", "--topics", patterns, str(tmp_path / "log.mcap")]) == 0
    assert {"/camera/left", "/wbc/reply"} <= set(read(tmp_path / "log-exported.mcap"))


def test_every_command_splits_topics_alike() -> None:
    for action in (REPLAY, RECORD_ACTION, EXPORT_ACTION):
        parser = argparse.ArgumentParser()
        action.add(parser)
        given = "plant/*, camera/left wbc/**"
        words = ["--topics", given] + (["log.mcap"] if action is not RECORD_ACTION else [])
        topics = parser.parse_args(words).topics
        # The recorder is another program, which splits them itself.
        if action is RECORD_ACTION:
            parsed = parser.parse_args([*words, "--exclude", given])
            settings = settings_of(parsed, {})
            assert settings.topics == settings.exclude
            topics = settings.topics
        assert topics == ("plant/*", "camera/left", "wbc/**")


def test_a_missing_log_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["export", str(tmp_path)]) == 1
    assert "cannot open the log" in capsys.readouterr().err
    assert list(tmp_path.iterdir()) == []


def test_a_missing_library_names_its_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "rosbags", None)
    assert main(["export", str(tmp_path)]) == 2
    assert "pip install '.[export]'" in capsys.readouterr().err


def test_view_without_rerun_names_its_extra(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    write(tmp_path / "log.mcap", session())
    monkeypatch.setitem(sys.modules, "rerun", None)
    assert main(["view", str(tmp_path)]) == 2
    assert "pip install '.[view]'" in capsys.readouterr().err


def test_help_says_what_the_times_are(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["export", "--help"])
    text = capsys.readouterr().out
    assert "log_time is the arrival at the logger" in text
    assert "examples:" in text
