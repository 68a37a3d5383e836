"""Samples as they come off the bus, and recorders fed with them."""

from pathlib import Path

import numpy as np
from mcap.writer import Writer

from common.schemas import (
    CameraFrame,
    EpisodeAction,
    EpisodeMark,
    Gait,
    GaitRequest,
    Header,
    LinkChange,
    Message,
)
from common.transport.tap import RawSample
from common.wire.codec import encode, schema_tag
from common.wire.header import wire_header
from services.logger.record.config import LoggerConfig
from services.logger.record.recorder import Recorder
from services.logger.record.sink import McapSink

START, END, DISCARD = EpisodeAction.START, EpisodeAction.END, EpisodeAction.DISCARD


def sample(key: str, message: Message, seq: int, at: int, source: str = "s") -> RawSample:
    """A message that arrived at ``at`` and was sent 1 ns before."""
    header = Header(seq=seq, sent=at - 1, boot=1, source=source)
    return RawSample(f"draco3/{key}", encode(message, header), schema_tag(type(message)), at)


def gait(seq: int, at: int | None = None) -> RawSample:
    message = GaitRequest(request_id=seq, gait=Gait.FORWARD)
    return sample("teleop/gait", message, seq, 1000 + seq if at is None else at, "teleop")


def picture(seq: int, size: int = 5000, at: int | None = None) -> RawSample:
    noise = np.random.default_rng(seq).bytes(size)
    frame = CameraFrame(eye="left", width=10, height=10, encoding="jpeg", data=noise)
    return sample("camera/left", frame, seq, 1000 + seq if at is None else at, "camera")


def mark(seq: int, number: int, action: EpisodeAction, at: int, label: str = "") -> RawSample:
    return sample("episode", EpisodeMark(episode=number, action=action, label=label), seq, at)


def link(seq: int, at: int, text: str = "250ms") -> RawSample:
    change = LinkChange(service="wbc", topic="teleop/setpoint", link=text, reason="request")
    return sample("link/wbc", change, seq, at, "wbc")


def write(
    path: Path,
    arrivals: list[RawSample],
    config: LoggerConfig | None = None,
    flush_each: int = 10**9,
) -> None:
    """A file without delivery statistics, as the sink alone writes it."""
    sink = McapSink(path, "draco3", config or LoggerConfig())
    for number, arrival in enumerate(arrivals, start=1):
        sink.write(arrival, wire_header(arrival.payload))
        if number % flush_each == 0:
            sink.flush()
    sink.close()


def record(path: Path, arrivals: list[RawSample], config: LoggerConfig | None = None) -> Recorder:
    """A whole recording, as the recorder writes it."""
    config = config or LoggerConfig()
    recorder = Recorder(McapSink(path, "draco3", config), config)
    recorder.start()
    for arrival in arrivals:
        recorder.intake.offer(arrival)
    recorder.stop()
    return recorder


def write_foreign(path: Path, count: int = 100, *, chunked: bool = False) -> None:
    """A valid file of another MCAP writer: ``count`` messages, as a rule outside chunks."""
    with path.open("wb") as stream:
        writer = Writer(stream, use_chunking=chunked)
        writer.start()
        schema = writer.register_schema("X", "jsonschema", b"{}")
        channel = writer.register_channel("draco3/x", "json", schema)
        for number in range(count):
            time = 10**9 + number * 10**7
            writer.add_message(channel, time, b"{}", time, number)
        writer.finish()
