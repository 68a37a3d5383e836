"""A log back on the bus: the same bytes, under another name, never beside a live robot."""

import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from common.schemas import Header, Message
from common.topics import PLANT_STATE, TELEOP_GAIT, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from common.transport.tap import RawSample, RawTap
from common.wire.codec import encode, schema_tag
from common.wire.header import wire_header
from lab.cli.main import main
from lab.errors import LabError
from lab.logs.playback import Extent, Player, PlayOptions, extent_of, play
from services.logger.read.reader import LogReader, RecordedMessage
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink
from tests.common.runtime.toys import gait_request
from tests.common.transport.support import free_base_port, plant_state

ROOT = Path(__file__).parents[3]
MS = 1_000_000


def sample(topic: Topic[Any], message: Any, number: int, place_ms: int) -> RawSample:
    header = Header(seq=number, stamp=place_ms * MS, boot=3, source="sim", sent=5)
    key = f"draco3/{topic.name}"
    schema: type[Message] = topic.schema
    return RawSample(key, encode(message, header), schema_tag(schema), 10**9 + place_ms * MS)


@pytest.fixture
def log(tmp_path: Path) -> tuple[Path, list[RawSample]]:
    """A second of states and a request each 200 ms, and a topic that no table knows."""
    states = [sample(PLANT_STATE, plant_state(), n, 20 * n) for n in range(51)]
    gaits = [sample(TELEOP_GAIT, gait_request(n), n, 200 * n + 1) for n in range(5)]
    other = RawSample("draco3/experiment/one", b"\x81\xa1x\x01", "private/1", 10**9 + 500 * MS)
    samples = sorted([*states, *gaits, other], key=lambda each: each.arrival_ns)
    sink = McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig())
    for each in samples:
        sink.write(each, None)
    sink.close()
    return tmp_path / "log.mcap", samples


@pytest.fixture
def port() -> int:
    return free_base_port(16)


@pytest.fixture
def heard(port: int) -> Iterator[dict[str, RawTap]]:
    """What viewers of the replay and of the live robot hear; one of them as `trill top` is."""
    bus = BusConfig(base_port=port)
    session: Any = open_session(bus, "top")
    try:
        yield {name: RawTap(session, name) for name in ("draco3-replay", "draco3", "other")}
    finally:
        session.close()


def options(port: int, **how: Any) -> PlayOptions:
    return PlayOptions(BusConfig(base_port=port), **how)


def settled(tap: RawTap, count: int) -> list[RawSample]:
    found: list[RawSample] = []
    end = time.monotonic() + 5.0
    while len(found) < count and time.monotonic() < end:
        found += tap.drain()
        time.sleep(0.02)
    return found + tap.drain()


def test_the_same_bytes_under_another_name(
    log: tuple[Path, list[RawSample]], port: int, heard: dict[str, RawTap]
) -> None:
    path, samples = log
    assert play(path, options(port)) == 0
    got = settled(heard["draco3-replay"], len(samples))
    for name in {each.key for each in samples}:
        then = [(each.payload, each.tag) for each in samples if each.key == name]
        key = name.replace("draco3/", "draco3-replay/")
        assert [(each.payload, each.tag) for each in got if each.key == key] == then
    assert len(got) == len(samples)
    assert heard["draco3"].received == 0
    # Paced: no earlier than then; how much later is the machine's affair.
    assert got[-1].arrival_ns - got[0].arrival_ns > 950 * MS


def test_a_window_some_topics_faster(
    log: tuple[Path, list[RawSample]], port: int, heard: dict[str, RawTap]
) -> None:
    path, _ = log
    how: dict[str, Any] = {"window": (0.2, 0.6), "topics": ("teleop/*",), "speed": 4.0}
    assert play(path, options(port, **how)) == 0
    got = settled(heard["draco3-replay"], 2)
    assert [each.arrival_ns for each in got] == sorted(each.arrival_ns for each in got)
    assert {each.key for each in got} == {"draco3-replay/teleop/gait"}
    assert len(got) == 2


def test_the_way_to_the_window_is_not_made_up_for(
    log: tuple[Path, list[RawSample]], port: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, _ = log

    class Wall:
        """A clock that reading an entry before the window moves by 50 ms."""

        now = 0.0

        def monotonic(self) -> float:
            return self.now

        def sleep(self, seconds: float) -> None:
            self.now += seconds

    wall, sent = Wall(), list[tuple[float, int]]()
    entries = LogReader(path).raw_messages()

    def slowly(_reader: LogReader) -> Iterator[RecordedMessage]:
        for entry in entries:
            wall.now += 0.05 if entry.log_time < 10**9 + 500 * MS else 0.0
            yield entry

    monkeypatch.setattr("lab.logs.playback.time", wall)
    monkeypatch.setattr("lab.logs.playback.LogReader.raw_messages", slowly)
    player = Player(None, path, Extent("draco3", 10**9, 2 * 10**9), options(port, window=(0.5, 9)))
    monkeypatch.setattr(player, "_publish", lambda e: sent.append((wall.now, e.log_time)))
    looks = len([place for place in player.play() if place == 0.5])
    assert looks >= 5
    (begun, first), *_ = sent
    assert begun > 1.0
    assert player.late == 0
    for at, log_time in sent:
        assert at - begun == pytest.approx(1e-9 * (log_time - first), abs=1e-3)


@pytest.mark.parametrize("later", [False, True])
def test_nothing_is_published_beside_a_live_robot(
    log: tuple[Path, list[RawSample]], port: int, heard: dict[str, RawTap], later: bool
) -> None:
    path, _ = log
    session: Any = open_session(BusConfig(base_port=port), "sim")
    live = Publisher(session, "draco3", PLANT_STATE, "sim", 99)
    over = threading.Event()

    def speak() -> None:
        while later and heard["draco3"].received < 100 and not over.wait(0.02):
            pass
        while not over.wait(0.02):
            live.send(plant_state())

    thread = threading.Thread(target=speak)
    thread.start()
    chosen = PlayOptions(BusConfig(base_port=port, robot="draco3"), named=True, loop=True)
    try:
        with pytest.raises(LabError, match="draco3/plant/state on this bus: a recording must"):
            play(path, chosen)
        heard_then = heard["draco3"].received
        time.sleep(0.3)
        more = heard["draco3"].received - heard_then
        replayed = [each for each in heard["draco3"].drain() if boot_of(each) == 3]
    finally:
        over.set()
        thread.join()
        session.close()
    assert 0 < more < 50  # only the live robot goes on speaking
    assert bool(replayed) == later


def boot_of(each: RawSample) -> int:
    header = wire_header(each.payload)
    return header.boot if header else -1


def test_the_recorded_name_if_nobody_has_it(
    log: tuple[Path, list[RawSample]], port: int, heard: dict[str, RawTap]
) -> None:
    path, samples = log
    chosen = PlayOptions(BusConfig(base_port=port, robot="draco3"), named=True, speed=10.0)
    assert play(path, chosen) == 0
    assert len(settled(heard["draco3"], len(samples))) == len(samples)


def test_ctrl_c_ends_a_loop_cleanly(
    log: tuple[Path, list[RawSample]], port: int, heard: dict[str, RawTap]
) -> None:
    path, samples = log
    process = subprocess.Popen(
        [sys.executable, "-m", "lab.cli", "replay", str(path), "--loop", "--speed", "20",
         "--base-port", str(port), "--as", "other"],
        cwd=path.parent, env={**os.environ, "PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip
    try:
        end = time.monotonic() + 30.0
        while heard["other"].received < 2 * len(samples) and time.monotonic() < end:
            time.sleep(0.05)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    finally:
        process.kill()
    assert process.returncode == 0, err
    assert "watch: trill top --robot other" in out
    assert "messages published as other" in out
    assert err == ""
    assert heard["other"].received >= 2 * len(samples)


def test_an_empty_log_is_said_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    McapSink(tmp_path / "log.mcap", "draco3", LoggerConfig()).close()
    assert main(["replay", str(tmp_path)]) == 1
    assert "holds no message" in capsys.readouterr().err


def test_the_extent_of_a_log(log: tuple[Path, list[RawSample]]) -> None:
    extent = extent_of(log[0])
    assert (extent.robot, extent.start_ns, extent.end_ns) == ("draco3", 10**9, 2 * 10**9)


def test_a_window_after_the_end_is_refused(
    log: tuple[Path, list[RawSample]], capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["replay", str(log[0]), "--from", "1.5"]) == 2
    assert "--from: expected at most 1.0" in capsys.readouterr().err
