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

LINKS = (TELEOP_SETPOINT.name, CAMERA_LEFT.name)
"""The links that are measured."""
RATE = 20.0
"""Messages per second on both links."""
PART = "LINK_STUDY_PART"
"""Environment variable with the name of the service that the script runs."""

_PERIOD_NS = round(1e9 / RATE)
_STEP_NS = 10_000_000
"""Period of a consumer that steps by the clock."""
_PICTURE_BYTES = 28_000
"""Size of a JPEG of the robot's cameras."""
_UNIT = np.array([1.0, 0.0, 0.0, 0.0])


class Sender(Service):
    """Sends set-points and pictures at 20 Hz each."""

    name = "teleop"
    period_ns = _PERIOD_NS
    writes: tuple[Topic[Any], ...] = (TELEOP_SETPOINT, CAMERA_LEFT)

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
        picture = bytes(_PICTURE_BYTES)
        frame = CameraFrame(
            header=header, eye="left", width=400, height=300, encoding="jpeg", data=picture
        )
        return [Output(TELEOP_SETPOINT, setpoint), Output(CAMERA_LEFT, frame)]


class Consumer(Service):
    """Reads one link; its journal says which message each step had."""

    def __init__(self, name: str, topic: Topic[Any], *, triggered: bool = False) -> None:
        """Step with the messages if ``triggered``, else by the clock at 100 Hz."""
        self.name = name
        self.reads = (topic,)
        self.trigger = topic if triggered else None
        self.period_ns = _PERIOD_NS if triggered else _STEP_NS

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Do nothing: the inbox has taken in what fell due."""
        del inputs, now_ns
        return []


def live_consumers() -> dict[str, Consumer]:
    """Return the consumers of a live measurement by their labels."""
    return {
        "command at 100 Hz": Consumer("wbc", TELEOP_SETPOINT),
        "command, triggered": Consumer("policy", TELEOP_SETPOINT, triggered=True),
        "camera, triggered": Consumer("keyboard", CAMERA_LEFT, triggered=True),
    }


def simulated_consumers() -> dict[str, Consumer]:
    """Return those of simulated time, where every service steps by the clock."""
    return {
        "command at 100 Hz": Consumer("wbc", TELEOP_SETPOINT),
        "camera at 100 Hz": Consumer("keyboard", CAMERA_LEFT),
    }


def _build(arguments: argparse.Namespace) -> Service:
    del arguments
    services: list[Service] = [Sender(), *live_consumers().values()]
    return next(service for service in services if service.name == os.environ[PART])


if __name__ == "__main__":
    sys.exit(run_live(_build, os.environ[PART]))
