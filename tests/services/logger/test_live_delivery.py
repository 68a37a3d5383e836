"""Publishers over real Zenoh and queues that are too small: every message is counted."""

import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from common.schemas import CameraFrame, Gait, GaitRequest
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, TELEOP_GAIT
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from common.transport.tap import RawSample, RawTap
from deploy.ports import reserve_base_port
from services.logger.read.reader import LogReader
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink

COUNT = 1500


@pytest.fixture
def sessions() -> Iterator[tuple[Any, Any]]:
    with reserve_base_port() as port:
        bus = BusConfig(base_port=port)
        sender: Any = open_session(bus, "sim")
        listener: Any = open_session(bus, "logger")
        yield sender, listener
        listener.close()
        sender.close()


def until(condition: Any, seconds: float = 20.0) -> None:
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.01)


def frame(eye: str) -> CameraFrame:
    data = bytes(20_000)
    return CameraFrame(eye=eye, width=4, height=4, encoding="jpeg", data=data)  # type: ignore[arg-type]


def test_sent_is_recorded_and_lost_and_dropped(sessions: tuple[Any, Any], tmp_path: Path) -> None:
    sender, listener = sessions
    config = LoggerConfig(queue_messages=40, queue_bytes=400_000, drain_period=0.05)
    recorder = Recorder(McapSink(tmp_path / "log.mcap", "draco3", config), config)
    tap = RawTap(listener, "draco3", deliver=recorder.intake.offer)
    gaits = [Publisher(sender, "draco3", TELEOP_GAIT, f"teleop{n}", 7 + n) for n in range(2)]
    eyes = [
        Publisher(sender, "draco3", topic, "cameras", 5) for topic in (CAMERA_LEFT, CAMERA_RIGHT)
    ]
    publishers: list[Publisher[Any]] = [*gaits, *eyes]
    until(lambda: all(one.wanted for one in publishers))
    recorder.start()
    for number in range(COUNT):
        # In bursts, so that the queue overflows at times and is empty at others.
        gaits[number % 2].send(GaitRequest(request_id=number, gait=Gait.FORWARD))
        if number % 10 == 0:
            eyes[0].send(frame("left"))
            eyes[1].send(frame("right"))
        if number % 100 == 0:
            time.sleep(0.06)
    received = tap.received
    while True:  # what is on its way arrives
        time.sleep(0.3)
        if tap.received == received:
            break
        received = tap.received
    # The last of each stream arrives for certain, so that the end of each stream is known.
    last = GaitRequest(request_id=COUNT, gait=Gait.NONE)
    for publisher, message in zip(
        publishers, (last, last, frame("left"), frame("right")), strict=True
    ):
        publisher.send(message)
        time.sleep(0.1)
    time.sleep(0.3)
    tap.close()
    report = recorder.stop()
    sent = {
        "draco3/teleop/gait": sum(one.sent for one in gaits),
        "draco3/camera/left": eyes[0].sent,
        "draco3/camera/right": eyes[1].sent,
    }
    assert {key: one.sent + one.earlier for key, one in report.items()} == sent
    reader = LogReader(tmp_path / "log.mcap")
    entries = list(reader.raw_messages())
    for key, count in report.items():
        assert count.sent == count.recorded + count.lost + count.dropped
        assert sum(entry.key == key for entry in entries) == count.recorded
        assert count.repeated == count.headerless == 0
    dropped = sum(one.dropped for one in report.values())
    assert dropped == recorder.intake.dropped > 50
    assert sum(one.recorded + one.dropped for one in report.values()) == tap.received
    assert reader.report == report


def test_a_tap_whose_receiver_raises_says_so(sessions: tuple[Any, Any]) -> None:
    sender, listener = sessions
    delivered: list[str] = []

    def deliver(sample: RawSample) -> None:
        if len(delivered) == 3:
            raise ValueError("no such luck")
        delivered.append(sample.key)

    tap = RawTap(listener, "draco3", deliver=deliver)
    gaits = Publisher(sender, "draco3", TELEOP_GAIT, "teleop", 1)
    until(lambda: gaits.wanted)
    assert tap.error is None
    for number in range(10):
        gaits.send(GaitRequest(request_id=number, gait=Gait.NONE))
    until(lambda: tap.error is not None)
    tap.close()
    assert delivered == ["draco3/teleop/gait"] * 3
    assert isinstance(tap.error, ValueError)


def test_closing_a_tap_is_no_error(sessions: tuple[Any, Any]) -> None:
    tap = RawTap(sessions[1], "draco3", deliver=lambda _: None)
    tap.close()
    assert tap.error is None


def test_the_tap_bounds_bytes_and_hears_each_key_once(sessions: tuple[Any, Any]) -> None:
    sender, listener = sessions
    tap = RawTap(
        listener,
        "draco3",
        max_bytes=50_000,
        expressions=["draco3/camera/*", "draco3/*/left", "draco3/camera/left"],
        accept=lambda key: not key.endswith("right"),
    )
    eyes = [
        Publisher(sender, "draco3", topic, "cameras", 5) for topic in (CAMERA_LEFT, CAMERA_RIGHT)
    ]
    until(lambda: all(one.wanted for one in eyes))
    for _ in range(10):
        eyes[0].send(frame("left"))
        eyes[1].send(frame("right"))
        time.sleep(0.01)
    until(lambda: tap.received >= 10)
    time.sleep(0.3)
    assert tap.received == 10
    assert [sample.key for sample in tap.drain()] == ["draco3/camera/left"] * 2
    tap.close()
