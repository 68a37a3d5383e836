"""Two live services for the studies: one that sends what a robot and an operator send, one reader.

Both are ordinary services under the ordinary runner. At their end they print, as one line of JSON,
what they did; the reader also prints at once what its runner says about its peers.
"""

import json
import logging
import os
import signal
import sys
import time
from argparse import ArgumentParser, Namespace
from collections import defaultdict
from collections.abc import Sequence
from types import FrameType
from typing import Any

import numpy as np

from common.inbox.inbox import Inbox
from common.robot.frames import NOMINAL_HAND_IN_BODY
from common.runtime.live.main import run_live
from common.runtime.service import Inputs, Output, Service
from common.schemas import Estop, Gait, GaitRequest, Message, PlantState, Setpoint
from common.topics import ESTOP, PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT, Topic
from common.transport.publisher import Publisher

TOPICS: tuple[Topic[Any], ...] = (PLANT_STATE, TELEOP_SETPOINT, TELEOP_GAIT, ESTOP)
_SOURCE_PERIOD_NS = 5_000_000
_EVERY = {PLANT_STATE.name: 1, TELEOP_SETPOINT.name: 10, TELEOP_GAIT.name: 40, ESTOP.name: 80}
"""In which of how many steps a topic is sent."""
HANG_S = 0.5
HEARD = "first state"
"""The reader says so, once."""


def messages() -> dict[str, Message]:
    """One message of each topic."""
    upright, joints, pair = np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(27), np.zeros(2)
    state = PlantState(
        base_position=np.zeros(3),
        base_quaternion=upright,
        base_linear_velocity=np.zeros(3),
        base_angular_velocity=np.zeros(3),
        joint_position=joints,
        joint_velocity=joints,
        joint_torque=joints,
        gripper_closure=pair,
        foot_normal_force=pair,
    )
    setpoint = Setpoint(
        left_hand_position_in_body=np.array(NOMINAL_HAND_IN_BODY["left"]),
        left_hand_quaternion_in_body=upright,
        right_hand_position_in_body=np.array(NOMINAL_HAND_IN_BODY["right"]),
        right_hand_quaternion_in_body=upright,
        gripper_closure=pair,
    )
    return {
        PLANT_STATE.name: state,
        TELEOP_SETPOINT.name: setpoint,
        TELEOP_GAIT.name: GaitRequest(request_id=1, gait=Gait.FORWARD),
        ESTOP.name: Estop(reason="study"),
    }


class Source(Service):
    """Sends states at 200 Hz, set-points at 20 Hz, gait requests at 5 Hz, stops at 2.5 Hz.

    On SIGUSR1 its next step hangs for :data:`HANG_S`.
    """

    name = "sim"
    period_ns = _SOURCE_PERIOD_NS
    writes = TOPICS

    def __init__(self) -> None:
        self._messages = messages()
        self._steps = 0
        self._hang = False
        self._puts: list[int] = []
        signal.signal(signal.SIGUSR1, self._note)
        self._time_puts()

    def step(self, _inputs: Inputs, _now_ns: int) -> Sequence[Output]:
        """Send what is due."""
        if self._hang:
            self._hang = False
            time.sleep(HANG_S)
        self._steps += 1
        return [
            Output(topic, self._messages[topic.name])
            for topic in TOPICS
            if self._steps % _EVERY[topic.name] == 0
        ]

    def close(self) -> None:
        """Print how long handing over to the transport took [ms]."""
        puts = 1e-6 * np.array(self._puts or [0])
        report = {"puts": len(puts), "p99": float(np.percentile(puts, 99)), "max": puts.max()}
        print(json.dumps(report), flush=True)

    def _note(self, _number: int, _frame: FrameType | None) -> None:
        self._hang = True

    def _time_puts(self) -> None:
        send, puts = Publisher.send, self._puts

        def timed(publisher: Publisher[Any], message: Message, captured_ns: int = 0) -> bool:
            started = time.monotonic_ns()
            try:
                return send(publisher, message, captured_ns)
            finally:
                puts.append(time.monotonic_ns() - started)

        Publisher.send = timed  # type: ignore[method-assign,assignment]


class Reader(Service):
    """Notes how old what it is given is, by the clock it shares with the source."""

    name = "wbc"
    period_ns = 10_000_000
    trigger = PLANT_STATE
    reads = TOPICS

    def __init__(self) -> None:
        self._ages: defaultdict[str, list[float]] = defaultdict(list)
        self._times: list[int] = []
        self._status: dict[str, dict[str, int]] = {}
        logging.getLogger("common.runtime.live.heartbeats").addHandler(_Teller())

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Note what is new."""
        for topic in TOPICS:
            if topic in {TELEOP_GAIT, ESTOP}:
                new = inputs.events(topic)
            elif inputs.updated(topic):
                new = [inputs.latest(topic)]
            else:
                new = []
            self._ages[topic.name] += [1e-9 * (now_ns - each.header.sent) for each in new]
        if inputs.updated(PLANT_STATE):
            if not self._times:
                print(f"{time.monotonic_ns()} {HEARD}", flush=True)
            self._times.append(now_ns)
        if isinstance(inputs, Inbox):
            for topic in TOPICS:
                status = inputs.health_of(topic)
                self._status[topic.name] = {
                    "stale": status.stale, "skipped": status.skipped, "gaps": status.gaps,
                }  # fmt: skip
        return ()

    def close(self) -> None:
        """Print ages [s], counters and when states were taken in [ns]."""
        report = {"ages": self._ages, "status": self._status, "times": self._times}
        print(json.dumps(report), flush=True)


class _Teller(logging.Handler):
    """Prints when something was logged [ns, monotonic], and what."""

    def emit(self, record: logging.LogRecord) -> None:
        now = time.monotonic_ns()
        print(f"{now} {record.getMessage()}", flush=True)


def _build(arguments: Namespace) -> Service:
    return Source() if arguments.role == "source" else Reader()


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--role", choices=["source", "reader"], default="source")


if __name__ == "__main__":
    role = "sim" if "source" in sys.argv else "wbc"
    os.environ.pop("TRILL_CONFIG", None)
    raise SystemExit(run_live(_build, role, add_arguments=_add_arguments))
