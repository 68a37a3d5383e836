"""A sender and consumers of the two links that are measured; as a script, one of them live."""

import argparse
import os
import sys
from collections.abc import Sequence
from typing import Any

import numpy as np

from common.runtime.live.main import run_live
from common.runtime.service import Inputs, Output, Service
from common.schemas import CameraFrame, Header, Setpoint
from common.topics import CAMERA_LEFT, TELEOP_SETPOINT, Topic

RATE = 20.0
"""Of both links [Hz]."""
PERIOD_NS = round(1e9 / RATE)
STEP_NS = 10_000_000
"""Of a consumer that steps by the clock."""
PICTURE_BYTES = 28_000
"""Of a JPEG of the robot's cameras."""

_UNIT = np.array([1.0, 0.0, 0.0, 0.0])


class Sender(Service):
    """Sends set-points and pictures at 20 Hz each."""

    name = "teleop"
    period_ns = PERIOD_NS
    writes: tuple[Topic[Any], ...] = (TELEOP_SETPOINT, CAMERA_LEFT)

    def __init__(self) -> None:
        """Make what is sent."""
        self._picture = bytes(PICTURE_BYTES)

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Send one of each."""
        del inputs
        header = Header(stamp=max(1, now_ns))
        setpoint = Setpoint(
            header=header,
            left_hand_position_in_body=np.array([0.3, 0.26, 0.04]),
            left_hand_quaternion_in_body=_UNIT,
            right_hand_position_in_body=np.array([0.3, -0.26, 0.04]),
            right_hand_quaternion_in_body=_UNIT,
            gripper_closure=np.zeros(2),
            neck_pitch=0.0,
        )
        frame = CameraFrame(
            header=header, eye="left", width=400, height=300, encoding="jpeg", data=self._picture
        )
        return [Output(TELEOP_SETPOINT, setpoint), Output(CAMERA_LEFT, frame)]


class Consumer(Service):
    """Reads one link; that it took in a message, and when, is in its journal."""

    def __init__(self, name: str, topic: Topic[Any], *, triggered: bool) -> None:
        """Step by the clock at 100 Hz, or with the messages."""
        self.name = name
        self.reads = (topic,)
        self.trigger = topic if triggered else None
        self.period_ns = PERIOD_NS if triggered else STEP_NS

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Nothing to do: the inbox has taken in what fell due."""
        del inputs, now_ns
        return []


def consumers() -> dict[str, Consumer]:
    """Those that are measured, by what they stand for."""
    return {
        "command at 100 Hz": Consumer("wbc", TELEOP_SETPOINT, triggered=False),
        "command, triggered": Consumer("policy", TELEOP_SETPOINT, triggered=True),
        "camera, triggered": Consumer("keyboard", CAMERA_LEFT, triggered=True),
    }


def simulated_consumers() -> dict[str, Consumer]:
    """The same in simulated time, where everything steps by the clock."""
    return {
        "command at 100 Hz": Consumer("wbc", TELEOP_SETPOINT, triggered=False),
        "camera at 100 Hz": Consumer("keyboard", CAMERA_LEFT, triggered=False),
    }


def _build(arguments: argparse.Namespace) -> Service:
    del arguments
    name = os.environ["LINK_STUDY_PART"]
    named: dict[str, Service] = {part.name: part for part in consumers().values()}
    return named.get(name) or Sender()


if __name__ == "__main__":
    sys.exit(run_live(_build, os.environ["LINK_STUDY_PART"]))
