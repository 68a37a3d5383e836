"""Logs to be exported, and exported files read back with the stock reader and decoders."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mcap.reader import make_reader
from mcap_ros2.decoder import DecoderFactory as Ros2Decoders

from common.robot.joints import NUM_JOINTS
from common.schemas import (
    CameraFrame,
    Gait,
    GaitOutcome,
    GaitReply,
    GaitRequest,
    Header,
    JointCommand,
    LinkHealth,
    Message,
    PlantState,
    ServiceHealth,
    Setpoint,
    StageTime,
)
from common.transport.tap import RawSample
from common.wire.codec import encode, schema_tag
from common.wire.header import wire_header
from services.logger.read import segments
from services.logger.record.config import LoggerConfig
from services.logger.record.sink import McapSink

MS = 1_000_000
EPOCH = 5_000_000_000_000
"""Of the recorder's monotonic clock [ns]."""


@dataclass(frozen=True)
class Read:
    """One message of an exported file."""

    topic: str
    schema: str
    message: Any
    log_time: int
    publish_time: int
    sequence: int


class ProtobufDecoders:
    """Decodes by the descriptors in the file alone, knowing nothing of the exporter's classes."""

    def decoder_for(self, encoding: str, schema: Any) -> Any:
        from google.protobuf.descriptor_pb2 import FileDescriptorSet
        from google.protobuf.descriptor_pool import DescriptorPool
        from google.protobuf.message_factory import GetMessageClass

        if encoding != "protobuf":
            return None
        pool = DescriptorPool()
        for file in FileDescriptorSet.FromString(schema.data).file:
            pool.Add(file)
        kind = GetMessageClass(pool.FindMessageTypeByName(schema.name))
        return kind.FromString


def read(path: Path) -> dict[str, list[Read]]:
    """All messages of an exported file, decoded, by topic."""
    found: dict[str, list[Read]] = {}
    with path.open("rb") as stream:
        reader = make_reader(stream, decoder_factories=[Ros2Decoders(), ProtobufDecoders()])
        for schema, channel, raw, message in reader.iter_decoded_messages():
            found.setdefault(channel.topic, []).append(
                Read(
                    channel.topic,
                    schema.name,
                    message,
                    raw.log_time,
                    raw.publish_time,
                    raw.sequence,
                )
            )
    return found


def origin_of(path: Path) -> dict[str, str]:
    """The metadata of a log that ties its clock to the wall."""
    return segments.origin_of(path) or {}


def sample(key: str, message: Message, seq: int, source: str = "sim", **header: int) -> RawSample:
    """A message of number ``seq`` that arrived ``EPOCH + 5 seq`` ms after the recorder's boot."""
    arrival = EPOCH + 5 * seq * MS
    full = Header(
        seq=seq, boot=1, source=source, stamp=5 * seq * MS, **{"sent": arrival - MS, **header}
    )
    return RawSample(f"draco3/{key}", encode(message, full), schema_tag(type(message)), arrival)


def write(path: Path, samples: list[RawSample], *, finish: bool = True) -> None:
    """A log; without ``finish`` as a killed logger leaves it."""
    sink = McapSink(path, "draco3", LoggerConfig())
    for one in samples:
        sink.write(one, wire_header(one.payload))
    if finish:
        sink.close()
    else:
        sink.flush()
        sink.abandon()


def turn(seed: int) -> Any:
    """A random unit quaternion (w, x, y, z), no two parts alike."""
    parts = np.random.default_rng(seed).normal(size=4)
    return parts / np.linalg.norm(parts)


def plant(seed: int) -> PlantState:
    """A plant state in which no two numbers are alike."""
    rng = np.random.default_rng(seed)
    return PlantState(
        base_position=rng.normal(size=3),
        base_quaternion=turn(seed),
        base_linear_velocity=rng.normal(size=3),
        base_angular_velocity=rng.normal(size=3),
        joint_position=rng.normal(size=NUM_JOINTS),
        joint_velocity=rng.normal(size=NUM_JOINTS),
        joint_torque=rng.normal(size=NUM_JOINTS),
        gripper_closure=rng.uniform(size=2),
        foot_normal_force=rng.uniform(size=2),
    )


def command(seed: int) -> JointCommand:
    rng = np.random.default_rng(seed)
    names = ("position", "velocity", "acceleration", "torque", "stiffness", "damping")
    vectors: dict[str, Any] = {name: rng.normal(size=NUM_JOINTS) for name in names}
    return JointCommand(**vectors, gripper_closure=np.zeros(2))


def setpoint(seed: int) -> Setpoint:
    rng = np.random.default_rng(seed)
    return Setpoint(
        left_hand_position_in_body=rng.normal(size=3),
        left_hand_quaternion_in_body=turn(seed),
        right_hand_position_in_body=rng.normal(size=3),
        right_hand_quaternion_in_body=turn(seed + 1),
        gripper_closure=np.zeros(2),
        neck_pitch=0.25,
    )


def health(service: str) -> ServiceHealth:
    link = LinkHealth(
        topic="teleop/setpoint",
        received=10,
        rate=20.0,
        age=0.125,
        gaps=2,
        refused=1,
        link="normal(122ms, 190ms)",
        requested_mean=0.122,
        achieved_mean=0.1225,
        stages=[
            StageTime(stage="wire", median=0.001, p99=0.002),
            StageTime(stage="injected", median=0.12, p99=0.19),
        ],
    )
    return ServiceHealth(
        service=service,
        pid=1,
        period=0.01,
        steps=1000,
        deadline_misses=3,
        step_median=0.002,
        step_p99=0.003,
        cpu=0.3,
        realtime="normal",
        links=[link],
    )


def session() -> list[RawSample]:
    """A little of everything, 20 states long."""
    jpeg = CameraFrame(eye="left", width=4, height=3, encoding="jpeg", data=b"\xff\xd8 any bytes")
    samples = []
    for i in range(20):
        samples += [
            sample("plant/state", plant(i), i),
            sample("wbc/command", command(100 + i), i, "wbc"),
        ]
        if i % 4 == 0:
            samples += [
                sample("teleop/setpoint", setpoint(200 + i), i, "teleop"),
                sample("camera/left", jpeg, i, "cameras", captured=EPOCH - 7 * MS),
                sample("plant/truth", plant(300 + i), i),
            ]
    refusal = GaitReply(
        request_id=7, gait=Gait.TURN_LEFT, outcome=GaitOutcome.REFUSED, reason="busy"
    )
    return [
        *samples,
        sample("health/wbc", health("wbc"), 20, "wbc"),
        sample("teleop/gait", GaitRequest(request_id=7, gait=Gait.TURN_LEFT), 21, "teleop"),
        sample("wbc/reply", refusal, 22, "wbc"),
    ]
