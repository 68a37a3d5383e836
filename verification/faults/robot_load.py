"""``python -m verification.faults.robot_load``: publishes what a robot does, without one.

State at 200 Hz, truth at 50, command and controller state at 100, two cameras at 20, and an episode
mark each half second, all real messages over real Zenoh. What was sent when is written to a
journal, so that a recording can be compared with it.
"""

import argparse
import heapq
import struct
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from common.runtime.live.realtime import DEFAULT_PRIORITY, enter_realtime
from common.runtime.live.stopping import StopSignals
from common.schemas import (
    CameraFrame,
    ControllerState,
    ControlState,
    EpisodeAction,
    EpisodeMark,
    Gait,
    JointCommand,
    Message,
    PlantState,
)
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    EPISODE,
    PLANT_STATE,
    PLANT_TRUTH,
    WBC_COMMAND,
    WBC_STATE,
    Topic,
)
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.schema_query import SchemaServer
from common.transport.session import new_boot_id, open_session

RATES: tuple[tuple[Topic[Any], float], ...] = (
    (PLANT_STATE, 200.0),
    (PLANT_TRUTH, 50.0),
    (WBC_COMMAND, 100.0),
    (WBC_STATE, 100.0),
    (CAMERA_LEFT, 20.0),
    (CAMERA_RIGHT, 20.0),
    (EPISODE, 2.0),
)
"""What is published and how often [Hz]; the numbers in the journal are places in this table."""
PICTURES = ("jpeg", "raw", "none")
JPEG_BYTES = 30_000
"""A 400 × 300 picture of a textured scene at quality 85 [bytes]."""
WIDTH, HEIGHT = 400, 300
ENTRY = struct.Struct("<BQQ")
"""One journal entry: topic, sequence number, monotonic time after sending [ns]."""
_FLUSH_S = 0.1
_LATE_S = 0.02


@dataclass(frozen=True)
class Sent:
    """One message that was handed to the transport."""

    topic: str
    seq: int
    at_ns: int


def read_journal(path: Path) -> Iterator[Sent]:
    """What was sent, in order; an entry not yet written completely is left out."""
    data = path.read_bytes()
    for offset in range(0, len(data) - ENTRY.size + 1, ENTRY.size):
        place, seq, at_ns = ENTRY.unpack_from(data, offset)
        yield Sent(RATES[place][0].name, seq, at_ns)


def make_messages(pictures: str, seed: int = 0) -> dict[str, list[Message]]:
    """Some messages of each topic, to be sent in turn; pictures as hard to compress as real ones.

    Args:
        pictures: ``jpeg`` (noise of the size of a JPEG), ``raw`` (a smooth scene with the noise
            of a sensor, 8-bit RGB) or ``none``.
        seed: of the noise.
    """
    rng = np.random.default_rng(seed)
    made: dict[str, list[Message]] = {
        PLANT_STATE.name: [_state(rng) for _ in range(16)],
        PLANT_TRUTH.name: [_state(rng) for _ in range(16)],
        WBC_COMMAND.name: [_command(rng) for _ in range(16)],
        WBC_STATE.name: [_controller(rng) for _ in range(16)],
    }
    if pictures != "none":
        frames = [_picture(rng, pictures) for _ in range(8)]
        made[CAMERA_LEFT.name] = list(frames)
        made[CAMERA_RIGHT.name] = [f.model_copy(update={"eye": "right"}) for f in frames]
    return made


def _state(rng: np.random.Generator) -> PlantState:
    quaternion = rng.normal(size=4)
    return PlantState(
        base_position=rng.normal(size=3),
        base_quaternion=quaternion / np.linalg.norm(quaternion),
        base_linear_velocity=rng.normal(size=3),
        base_angular_velocity=rng.normal(size=3),
        joint_position=rng.normal(size=27),
        joint_velocity=rng.normal(size=27),
        joint_torque=rng.normal(size=27),
        gripper_closure=rng.uniform(size=2),
        foot_normal_force=rng.uniform(size=2),
    )


def _command(rng: np.random.Generator) -> JointCommand:
    return JointCommand(
        position=rng.normal(size=27),
        velocity=rng.normal(size=27),
        acceleration=rng.normal(size=27),
        torque=rng.normal(size=27),
        stiffness=rng.uniform(size=27),
        damping=rng.uniform(size=27),
        gripper_closure=rng.uniform(size=2),
    )


def _controller(rng: np.random.Generator) -> ControllerState:
    return ControllerState(
        state=ControlState.BALANCE,
        gait=Gait.NONE,
        gait_progress=0.0,
        gaits_completed=0,
        dcm_error=float(rng.uniform()),
        com_in_world=rng.normal(size=3),
        hand_position_error=rng.uniform(size=2),
        hand_rotation_error=rng.uniform(size=2),
        hand_weight=1.0,
        setpoint_fresh=True,
        solver="osqp",
        unsolved=0,
    )


def _picture(rng: np.random.Generator, kind: str) -> CameraFrame:
    if kind == "jpeg":
        data = rng.bytes(JPEG_BYTES)
    else:
        x, y = np.meshgrid(np.linspace(0, 9, WIDTH), np.linspace(0, 7, HEIGHT))
        scene = 110 + 60 * np.sin(x + rng.uniform()) * np.cos(y)
        noisy = scene[:, :, None] + rng.normal(scale=2.0, size=(HEIGHT, WIDTH, 3))
        data = noisy.astype(np.uint8).tobytes()
    encoding = "jpeg" if kind == "jpeg" else "rgb8"
    return CameraFrame(eye="left", width=WIDTH, height=HEIGHT, encoding=encoding, data=data)  # type: ignore[arg-type]


class Load:
    """Publishes at the table's rates until stopped."""

    def __init__(self, bus: BusConfig, pictures: str, stop: StopSignals) -> None:
        """Open the bus as the plant would; ``stop`` ends :meth:`run`."""
        self._session: Any = open_session(bus, "sim")
        boot = new_boot_id()
        self._messages = make_messages(pictures)
        self._publishers = [
            Publisher(self._session, bus.robot, topic, "load", boot) for topic, _ in RATES
        ]
        self._schemas = SchemaServer(
            self._session, bus.robot, "load", [topic for topic, _ in RATES]
        )
        self._marks = 0
        self._stop = stop

    def run(self, journal: Path, seconds: float = float("inf")) -> None:
        """Publish and write down what was sent."""
        start = time.monotonic()
        due = [(start + 1e-3 * place, place) for place in range(len(RATES))]
        heapq.heapify(due)
        flush_at = start
        with journal.open("wb") as stream:
            while not self._stop.requested and due[0][0] < start + seconds:
                at, place = due[0]
                now = time.monotonic()
                if now < at:
                    if now >= flush_at:
                        stream.flush()
                        flush_at = now + _FLUSH_S
                    time.sleep(min(at - now, 0.02))
                    continue
                # What came too late is not made up for: bursts are no robot's.
                on_time = at if now - at < _LATE_S else now
                heapq.heapreplace(due, (on_time + 1 / RATES[place][1], place))
                self._send(place, stream)

    def _send(self, place: int, stream: Any) -> None:
        topic, publisher = RATES[place][0], self._publishers[place]
        if topic is EPISODE:
            action = EpisodeAction.END if self._marks % 2 else EpisodeAction.START
            number = self._marks // 2
            message: Message = EpisodeMark(episode=number, action=action, label=f"trial {number}")
            self._marks += 1
        elif topic.name in self._messages:
            choices = self._messages[topic.name]
            message = choices[publisher.sent % len(choices)]
        else:
            return
        seq = publisher.sent + publisher.errors
        if publisher.send(message):
            stream.write(ENTRY.pack(place, seq, time.monotonic_ns()))

    def close(self) -> None:
        """Leave the bus."""
        self._schemas.close()
        self._session.close()


def main(argv: list[str] | None = None) -> int:
    """Publish until a signal or the time is up."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faults.robot_load",
        description=(__doc__ or "").split(":", 1)[1],
    )
    parser.add_argument("--base-port", type=int, required=True, help="of the bus")
    parser.add_argument("--pictures", choices=PICTURES, default="jpeg")
    parser.add_argument("--journal", type=Path, required=True, help="what was sent, binary")
    parser.add_argument("--seconds", type=float, default=float("inf"))
    arguments = parser.parse_args(argv)
    # As the robot's services, so that what is lost is the recorder's doing.
    enter_realtime(DEFAULT_PRIORITY)
    bus = BusConfig(base_port=arguments.base_port)
    load = Load(bus, arguments.pictures, StopSignals().install())
    try:
        load.run(arguments.journal, arguments.seconds)
    finally:
        load.close()
    return 0


if __name__ == "__main__":
    sys.exit(main())
