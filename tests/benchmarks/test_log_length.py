"""A long log is consistent in itself, and what commands use on it is measured."""

from pathlib import Path

import pytest

from benchmarks.bench_log_length import use_of
from benchmarks.builds import own_and
from benchmarks.long_log import Part, record_part, write_long_log
from lab.logs.ledger_log import ledger_table
from lab.logs.replay_check import CheckOptions, runs_in
from lab.logs.replay_report import check
from services.logger.read.info import read_info
from services.logger.read.reader import LogReader

SECONDS = 3


@pytest.fixture(scope="module")
def part() -> Part:
    return record_part(SECONDS)


def test_a_continued_log_has_no_gap(part: Part, tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    assert write_long_log(log, part, 4) == 4 * len(part.samples)
    info = read_info(log)
    assert info.whole
    assert info.seconds == pytest.approx(4 * SECONDS, abs=0.1)
    assert sum(topic.messages for topic in info.topics) == 4 * len(part.samples)
    assert sum(topic.count.missing + topic.count.repeated for topic in info.topics) == 0
    assert [episode.episode for episode in info.episodes] == [0, 1, 2, 3]
    runs = {run.service: run for run in runs_in(log)}
    assert {name: run.length for name, run in runs.items()} == {
        "sim": 4000 * SECONDS, "wbc": 400 * SECONDS, "teleop": 80 * SECONDS,
    }  # fmt: skip
    assert not any(run.obstacle or run.ends for run in runs.values())
    states = next(r for r in ledger_table(LogReader(log)).inputs if r.topic == "plant/state")
    assert states.applied == pytest.approx(800 * SECONDS, abs=8)
    assert use_of(own_and(None)[0], ("info",), log).memory > 20.0


def test_restarted_runs_are_replayed_to_the_byte(
    part: Part, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = tmp_path / "log.mcap"
    write_long_log(log, part, 2, restarts=True)
    assert [run.number for run in runs_in(log) if run.service == "wbc"] == [1, 2]
    assert check(log, CheckOptions(services=("wbc", "teleop"))) == 0
    assert capsys.readouterr().out.count("IDENTICAL to the byte") == 4
