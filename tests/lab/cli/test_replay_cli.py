"""``trill replay``: recorded services run again, on the golden log and on broken ones."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from common.schemas import StepJournal
from common.topics import JOURNAL
from common.transport.tap import RawSample
from common.wire.codec import decode, encode
from common.wire.header import wire_header
from lab.cli.main import main
from services.logger.read.reader import LogReader, RecordedMessage
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from services.teleop.scripted.library import SCRIPTS, ScriptOptions
from services.teleop.scripted.service import ScriptedOperator
from tests.golden.make import GOLDEN, write

OTHER_PROCESSORS = "1e-6"
"""See tests/golden/README.md."""


@pytest.fixture(scope="module")
def fresh(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A log made by this very machine."""
    path = tmp_path_factory.mktemp("run") / "log.mcap"
    write(path, 1.4)
    return path


def rewritten(path: Path, to: Path, change: Callable[[RecordedMessage], bytes | None]) -> Path:
    """Copy a log with other payloads, or (None) without a message."""
    sink = McapSink(to, "draco3", LoggerConfig())
    for raw in LogReader(path).raw_messages():
        payload = change(raw)
        if payload is not None:
            sample = RawSample(raw.key, payload, raw.tag, raw.log_time)
            sink.write(sample, wire_header(payload))
    sink.close()
    return to


def test_a_log_of_this_machine_is_identical_to_the_byte(
    fresh: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(fresh.parent), "--check"]) == 0
    out = capsys.readouterr().out
    assert "IDENTICAL to the byte" in out
    assert "wbc/command         125 compared, 125 equal\n" in out


def test_the_golden_log_is_what_todays_controller_says(capsys: pytest.CaptureFixture[str]) -> None:
    words = ["replay", str(GOLDEN), "--service", "wbc", "--tolerance", OTHER_PROCESSORS]
    code = main([*words, "--verbose"])
    out = capsys.readouterr().out
    assert code == 0, out
    assert "226 steps" in out
    assert "wbc/command         225 compared" in out
    assert "wbc/reply             1 compared, 1 equal\n" in out
    for lack in ("differing", "missing", "extra", "not recorded"):
        assert lack not in out


def test_a_changed_gain_shows_where_it_begins_to_matter(
    capsys: pytest.CaptureFixture[str],
) -> None:
    words = ["replay", str(GOLDEN), "--service", "wbc", "--tolerance", OTHER_PROCESSORS]
    assert main([*words, "--set", "tasks.hand_position.kp=202"]) == 1
    out = capsys.readouterr().out
    assert "DIFFERENT" in out
    assert "wbc/command number 1 differs" in out or "wbc/command number 0 differs" in out
    # This one counts only once a foot is being lifted.
    assert main([*words, "--set", "tasks.foot_weight_swing=44"]) == 1
    out = capsys.readouterr().out
    step = int(out.partition("first difference at step ")[2].split()[0])
    assert 130 < step < 190
    assert "torque[" in out
    assert "|Δ|" in out


def test_the_outputs_are_written_as_a_log(fresh: Path, tmp_path: Path) -> None:
    out = tmp_path / "again.mcap"
    assert main(["replay", str(fresh), "--service", "wbc", "--out", str(out)]) == 0
    again = {(raw.key, raw.sequence): raw for raw in LogReader(out).raw_messages()}
    then = {(raw.key, raw.sequence): raw for raw in LogReader(fresh).raw_messages()}
    assert len(again) > 250
    for name, raw in again.items():
        assert raw.payload == then[name].payload
        assert raw.tag == then[name].tag


def test_a_window_in_seconds_of_the_run(fresh: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(fresh), "--check", "--from", "0.5", "--until", "1"]) == 0
    assert "wbc/command          51 compared, 51 equal" in capsys.readouterr().out


def test_runs_are_listed(fresh: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(fresh), "--list"]) == 0
    assert capsys.readouterr().out.splitlines()[1].split() == ["wbc", "1", "126", "1.2", "yes"]


@pytest.mark.parametrize(
    ("words", "reason"),
    [
        (["--service", "sim"], "no journal of 'sim'; it has those of wbc"),
        (["--service", "wbc", "--run", "2"], "expected a run of wbc from 1 to 1, got 2"),
        (["--check", "--run", "2"], "nothing in the log can be replayed"),
        (["--check", "--set", "tasks.torso.kp=1"], "--set needs exactly one --service"),
        (["--service", "wbc", "--set", "tasks.torso.kq=1"], "tasks.torso.kq: no such key"),
        (["--service", "wbc", "--set", "tasks"], "expected KEY=VALUE"),
        (["--service", "wbc", "--loop"], "--loop is for publishing only"),
        (["--tolerance", "1e-9"], "--tolerance needs --service"),
        (["--from", "3", "--until", "2"], "expected --until after --from"),
        (["--topics", "wbc/*,nonsense"], "no topic matches 'nonsense'"),
    ],
)
def test_wrong_use_is_explained(
    words: list[str], reason: str, fresh: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(fresh), *words]) == 2
    assert reason in capsys.readouterr().err


def test_no_log_is_no_replay(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["replay", str(tmp_path), "--check"]) == 2
    assert "cannot open the log" in capsys.readouterr().err


def test_a_log_that_began_too_late(
    fresh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def later(raw: RecordedMessage) -> bytes | None:
        return None if raw.log_time < 600_000_000 else raw.payload

    log = rewritten(fresh, tmp_path / "late.mcap", later)
    assert main(["replay", str(log), "--service", "wbc"]) == 2
    assert "recording began at step 51 of wbc, in the middle" in capsys.readouterr().err
    assert main(["replay", str(log), "--list"]) == 0
    assert "no: recording began at step 51" in " ".join(capsys.readouterr().out.split())


def test_a_log_without_settings(
    fresh: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def without(raw: RecordedMessage) -> bytes | None:
        if raw.topic is not JOURNAL:
            return raw.payload
        journal = decode(raw.payload, StepJournal)
        return encode(journal.model_copy(update={"settings": ""}), journal.header)

    log = rewritten(fresh, tmp_path / "without.mcap", without)
    assert main(["replay", str(log), "--service", "wbc"]) == 2
    assert "does not have its settings" in capsys.readouterr().err


def test_an_operator_is_built_again_from_its_settings() -> None:
    for name, make in SCRIPTS.items():
        operator = ScriptedOperator(make(ScriptOptions(seed=4)))
        again = ScriptedOperator.from_settings(json.loads(json.dumps(operator.settings)))
        assert again.script == operator.script, name
        assert again.config == operator.config
