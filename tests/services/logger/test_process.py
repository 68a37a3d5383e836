"""The logger as a process, fed over loopback."""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

from common.schemas import CameraFrame, Gait, GaitRequest
from common.topics import CAMERA_LEFT, TELEOP_GAIT
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from deploy.ports import reserve_base_port
from services.logger.read.reader import LogReader

BOOT = 77


class Feed:
    """Publishes numbered events and pictures from this process."""

    def __init__(self, bus: BusConfig) -> None:
        self.session: Any = open_session(bus, "teleop")
        self.gaits = Publisher(self.session, bus.robot, TELEOP_GAIT, "teleop", BOOT)
        self.pictures = Publisher(self.session, bus.robot, CAMERA_LEFT, "camera", BOOT)
        self.sent_at: list[int] = []

    def send(self) -> None:
        number = len(self.sent_at)
        self.sent_at.append(time.monotonic_ns())
        self.gaits.send(GaitRequest(request_id=number, gait=Gait.FORWARD))
        if number % 10 == 0:
            data = number.to_bytes(4, "little") * 500
            frame = CameraFrame(eye="left", width=4, height=4, encoding="jpeg", data=data)
            self.pictures.send(frame)

    def send_for(self, seconds: float, rate: float = 300.0) -> None:
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            self.send()
            time.sleep(1 / rate)

    def send_until_recorded(self, log: Path) -> None:
        deadline = time.monotonic() + 30.0
        while not (log.exists() and log.stat().st_size > 3000):
            assert time.monotonic() < deadline, "the logger recorded nothing"
            self.send()
            time.sleep(0.005)


@contextmanager
def logger(out: Path, base_port: int) -> Iterator["subprocess.Popen[str]"]:
    process = subprocess.Popen(
        [sys.executable, "-m", "services.logger", "--out", str(out), "--base-port", str(base_port)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    try:
        yield process
    finally:
        process.kill()
        process.communicate()


@pytest.fixture
def bus() -> Iterator[BusConfig]:
    with reserve_base_port() as port:
        yield BusConfig(base_port=port)


@pytest.fixture
def feed(bus: BusConfig) -> Iterator[Feed]:
    made = Feed(bus)
    yield made
    made.session.close()


def test_kill_loses_less_than_a_second(bus: BusConfig, feed: Feed, tmp_path: Path) -> None:
    with logger(tmp_path, bus.base_port) as process:
        feed.send_until_recorded(tmp_path / "log.mcap")
        feed.send_for(2.0)
        os.kill(process.pid, signal.SIGKILL)
        killed = time.monotonic_ns()
        process.wait()
    reader = LogReader(tmp_path / "log.mcap")
    entries = [entry for entry in reader.raw_messages() if entry.topic is TELEOP_GAIT]
    assert reader.truncated
    recorded = [entry.sequence for entry in entries]
    assert recorded == list(range(recorded[0], recorded[0] + len(recorded)))
    assert killed - feed.sent_at[recorded[-1]] < 1e9
    assert killed - entries[-1].log_time < 1e9
    messages = [m for topic, m in reader.messages() if topic is TELEOP_GAIT]
    assert [m.request_id for m in messages] == recorded  # type: ignore[attr-defined]


def test_stop_records_and_counts_everything(bus: BusConfig, feed: Feed, tmp_path: Path) -> None:
    with logger(tmp_path, bus.base_port) as process:
        feed.send_until_recorded(tmp_path / "log.mcap")
        feed.send_for(0.5)
        time.sleep(0.5)  # what is on its way arrives
        process.send_signal(signal.SIGINT)
        printed, _ = process.communicate(timeout=30)
    assert process.returncode == 0
    reader = LogReader(tmp_path / "log.mcap")
    entries = [entry for entry in reader.raw_messages() if entry.topic is TELEOP_GAIT]
    assert not reader.truncated
    assert entries[-1].sequence == len(feed.sent_at) - 1
    count = reader.report["draco3/teleop/gait"]
    assert (count.recorded, count.dropped, count.lost) == (len(entries), 0, 0)
    assert count.sent + count.earlier == feed.gaits.sent
    total = next(line for line in printed.splitlines() if line.startswith("total")).split()
    assert int(total[2]) == sum(one.recorded for one in reader.report.values())
    for entry in entries:
        assert entry.publish_time >= feed.sent_at[entry.sequence]
        assert entry.log_time >= entry.publish_time


def test_an_unwritable_directory_ends_it_with_a_reason(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with reserve_base_port() as port, logger(tmp_path / "file", port) as process:
        printed, _ = process.communicate(timeout=30)
    assert process.returncode == 1
    assert "cannot write the log" in printed
    assert "Traceback" not in printed


def test_a_wrong_option_is_a_configuration_error(tmp_path: Path) -> None:
    config = tmp_path / "stack.toml"
    config.write_text("[logger]\nflush_period = 9.0\n")
    command = [sys.executable, "-m", "services.logger", "--out", str(tmp_path / "out")]
    ended = subprocess.run(
        [*command, "--config", str(config)], capture_output=True, text=True, check=False
    )
    assert ended.returncode == 2
    assert "flush_period" in ended.stderr


def test_two_loggers_in_one_directory_are_refused(
    bus: BusConfig, feed: Feed, tmp_path: Path
) -> None:
    with logger(tmp_path, bus.base_port) as first:
        feed.send_until_recorded(tmp_path / "log.mcap")
        with logger(tmp_path, bus.base_port + 100) as second:
            said, _ = second.communicate(timeout=60)
        assert second.returncode == 1
        assert "being recorded by another logger" in said
        assert first.poll() is None
    assert not (tmp_path / "log-2.mcap").exists()


def test_a_recorder_that_hears_nothing_says_where_it_listens(
    tmp_path: Path, bus: BusConfig
) -> None:
    with logger(tmp_path / "run", bus.base_port) as process:
        assert process.stdout is not None
        lines = iter(process.stdout.readline, "")
        warning = next(line for line in lines if "nothing heard" in line)
        assert str(bus.base_port) in warning
        assert "--connect" in warning
        process.send_signal(signal.SIGINT)
        assert process.wait(20) == 0


def test_a_recorder_that_fails_leaves_no_empty_directory(tmp_path: Path) -> None:
    (tmp_path / "run").mkdir()
    for words in (["--min-free", "900000TB"], ["--topics", "a//b"]):
        command = [sys.executable, "-m", "services.logger", "--out", str(tmp_path / "run"), *words]
        done = subprocess.run(command, capture_output=True, check=False)
        assert done.returncode in {1, 2}
        assert not (tmp_path / "run").exists()
