"""Summary file and report of a recorded run."""

import json
from pathlib import Path

import pytest
from mcap.writer import Writer

from common.schemas import Gait, Header
from common.topics import TELEOP_GAIT
from common.wire.header import wire_header
from deploy.launch import Verdict
from lab.errors import LabError
from lab.review.report import file_lines, known_verdict, report_lines, write_summary
from lab.review.summary import summarise
from services.logger.errors import LoggerError
from services.logger.log_format import DELIVERY_METADATA
from services.logger.read.delivery import DeliveryStats
from services.logger.read.info import read_info
from services.logger.read.locks import locked
from services.logger.read.segments import next_segment
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink
from tests.disk import fill
from tests.lab.monitor.test_bus_stats import sample
from tests.lab.review.synthetic import FakeRobot
from tests.services.logger.support import gait


def recorded(run_dir: Path) -> None:
    robot = FakeRobot()
    sink = McapSink(run_dir / "log.mcap", "draco3", LoggerConfig())
    for pair in robot.gait(0, Gait.FORWARD, (0, 0, 0), (0.2, 0, 0)):
        one = sample(pair, at=robot.now / 1000)
        sink.write(one, wire_header(one.payload))
    stats = DeliveryStats()
    for seq in range(3):
        stats.drop(f"draco3/{TELEOP_GAIT.name}", Header(seq=seq, boot=1, source="teleop"))
    sink.note(DELIVERY_METADATA, stats.to_metadata())
    sink.close()


def test_a_log_becomes_a_summary_file_and_a_report(tmp_path: Path) -> None:
    recorded(tmp_path)
    summary = write_summary(tmp_path / "log.mcap", Verdict("completed"), {"torque_mode": "rated"})
    assert summary.gaits["forward"].completed == 1
    assert summary.topics[TELEOP_GAIT.name].dropped == 3
    assert not summary.log_truncated
    kept = json.loads((tmp_path / "summary.json").read_text())
    assert kept["environment"]["torque_mode"] == "rated"
    assert kept["environment"]["python"].startswith("3.")
    assert kept["gait_runs"][0]["forward"] == pytest.approx(0.2)
    text = "\n".join(report_lines(summary))
    assert "1 completed of 1 accepted and 1 requested" in text
    assert "forward +0.200 m of +0.200" in text
    assert "3 dropped" in text
    assert [line.split()[-1] for line in file_lines(tmp_path / "log.mcap")] == [
        str(tmp_path / "log.mcap"),
        str(tmp_path / "summary.json"),
    ]


def test_summing_up_again_keeps_the_verdict(tmp_path: Path) -> None:
    recorded(tmp_path)
    write_summary(tmp_path / "log.mcap", Verdict("interrupted", "why"), {"torque_mode": "rated"})
    verdict, settings = known_verdict(tmp_path / "log.mcap")
    assert verdict == Verdict("interrupted", "why")
    assert settings["torque_mode"] == "rated"
    (tmp_path / "summary.json").write_text("{}")
    verdict, settings = known_verdict(tmp_path / "log.mcap")
    assert (verdict.outcome, settings) == ("unknown", {})


def test_a_truncated_log_is_summed_up_and_reported_as_truncated(tmp_path: Path) -> None:
    recorded(tmp_path)
    log = tmp_path / "log.mcap"
    log.write_bytes(log.read_bytes()[:-100])
    summary = write_summary(tmp_path / "log.mcap", Verdict("completed"), {})
    assert summary.log_truncated
    assert "truncated" in report_lines(summary)[-1]
    with pytest.raises(LoggerError, match="cannot open"):
        write_summary(tmp_path / "none" / "log.mcap", Verdict("completed"), {})


def test_a_log_that_is_being_recorded_is_not_called_truncated(tmp_path: Path) -> None:
    recorded(tmp_path)
    log = tmp_path / "log.mcap"
    log.write_bytes(log.read_bytes()[:-100])
    with locked(log):
        summary = write_summary(log, Verdict("unknown"), {})
    assert not summary.log_truncated
    assert "still being recorded" in report_lines(summary)[-1]


@pytest.mark.parametrize("count", [0, 3])
def test_the_log_of_something_else_has_no_report(tmp_path: Path, count: int) -> None:
    log = tmp_path / "log.mcap"
    with log.open("wb") as stream:
        writer = Writer(stream)
        writer.start()
        channel = writer.register_channel("/chatter", "cdr", 0)
        for number in range(count):
            writer.add_message(channel, number, b"hello", number)
        writer.finish()
    with pytest.raises(LabError, match=r"log\.mcap holds no message of this project.*trill info"):
        write_summary(log, Verdict("unknown"), {})
    assert not (tmp_path / "summary.json").exists()
    # What is known of a run is kept, though nothing was recorded.
    assert write_summary(log, Verdict("interrupted", "why"), {}).reason == "why"


def test_an_empty_log_has_a_report_too() -> None:
    text = "\n".join(report_lines(summarise([], outcome="service died", reason="wbc ended")))
    assert "service died: wbc ended" in text


def test_a_full_disk_does_not_destroy_the_verdict(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded(tmp_path)
    write_summary(tmp_path / "log.mcap", Verdict("timed out", "too slow"), {"torque_mode": "rated"})
    fill(monkeypatch)
    with pytest.raises(LabError, match="No space left"):
        write_summary(tmp_path / "log.mcap", Verdict("completed"), {})
    verdict, settings = known_verdict(tmp_path / "log.mcap")
    assert (verdict, settings["torque_mode"]) == (Verdict("timed out", "too slow"), "rated")


def test_a_recording_in_two_sessions_is_reported_as_info_counts_it(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    for session, numbers in (("a", range(100)), ("b", range(1271, 1300))):
        about = {"session": session, "recording": "a"}
        config = LoggerConfig()
        recorder = Recorder(McapSink(next_segment(log), "draco3", config, about), config)
        recorder.start()
        for seq in numbers:
            recorder.intake.offer(gait(seq, at=10**12 + seq * 10**7))
        recorder.stop()
    # What was sent while no logger ran is no loss of a logger.
    (topic,) = read_info(log).topics
    assert (topic.count.sent, topic.count.lost) == (129, 0)
    summary = write_summary(log, Verdict("completed"), {})
    assert summary.topics[TELEOP_GAIT.name].messages == 129
    assert summary.topics[TELEOP_GAIT.name].gaps == 0
    text = "\n".join(report_lines(summary))
    assert "0 missing" in text
    assert "a pause of 0:00:12 (h:min:s) before log-2.mcap" in text
    assert str(tmp_path / "log-2.mcap") in "\n".join(file_lines(log))
