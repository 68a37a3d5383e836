"""Measure the emergency stop of a running system: from the press of a button to limp motors.

The whole robot's side runs as separate processes, with log and cameras, and both cameras' pictures
are taken in. Again and again the robot stands, is stopped, and after the plant's confirmation it is
cleared and reset. Time runs from the press to the moment at which the plant sends its first state
of limp motors; both clocks are the machine's monotonic one. The same is then measured with a link
that loses half of the stop's messages.

    python benchmarks/bench_estop.py [--stops N]
"""

import argparse
import os
import random
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from common.estop import LONGEST_POLL_PERIOD, StopButton
from common.plant.fallback import DAMP_DAMPING
from common.runtime.live.realtime import DEFAULT_PRIORITY, enter_realtime
from common.schemas import EstopClear, GuardMode, PlantAction, PlantRequest, PlantState, PlantStatus
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    ESTOP,
    ESTOP_CLEAR,
    PLANT_REQUEST,
    PLANT_STATE,
    PLANT_STATUS,
)
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id, open_session
from common.transport.tap import RawSample, RawTap
from common.wire.codec import decode
from deploy.launch import running_system
from deploy.system import SystemOptions

NAME = "bench-estop"
LIMP = 5.0
"""Torque beyond which a motor does not only damp its present speed [N·m]."""
PATIENCE_S = 60.0
REPEAT_S = 1.0
"""Clear and reset are sent again if nothing has come of them after this time [s]."""
CONDITIONS = {"no loss": "", "half of the messages lost": "sim:estop=0ms loss=50%"}


class Stop(NamedTuple):
    """Times of one stop, from the press [s]."""

    limp: float
    confirmed: float


def _is_limp(state: PlantState) -> bool:
    """Return whether the motors only damp the speed that a joint had before or has now."""
    torque = np.abs(state.joint_torque)
    rest = np.abs(state.joint_torque + DAMP_DAMPING * state.joint_velocity)
    return state.guard is GuardMode.ESTOP and bool((np.minimum(torque, rest) <= LIMP).all())


class Robot:
    """The robot as its stop button sees it; messages come in a thread of the tap."""

    def __init__(self, bus: BusConfig) -> None:
        self._changed = threading.Condition()
        self._status: PlantStatus | None = None
        self._state: PlantState | None = None
        self._heard: PlantStatus | None = None
        self.stopped: PlantState | None = None
        self.pictures = 0
        self._session: Any = open_session(bus, NAME)
        robot, boot = bus.robot, new_boot_id()
        self._keys = {f"{robot}/{topic.name}": topic for topic in (PLANT_STATE, PLANT_STATUS)}
        pictures = [f"{robot}/{topic.name}" for topic in (CAMERA_LEFT, CAMERA_RIGHT)]
        self._tap = RawTap(
            self._session,
            robot,
            deliver=self._receive,
            expressions=[*self._keys, *pictures],
        )
        self._stop, self._clear, self._request = (
            Publisher(self._session, robot, topic, NAME, boot)
            for topic in (ESTOP, ESTOP_CLEAR, PLANT_REQUEST)
        )

    def close(self) -> None:
        """Leave the bus."""
        self._tap.close()
        self._session.close()

    def _receive(self, sample: RawSample) -> None:
        topic = self._keys.get(sample.key)
        if topic is None:
            self.pictures += 1
            return
        message = decode(sample.payload, topic.schema)
        with self._changed:
            if isinstance(message, PlantStatus):
                self._status = self._heard = message
            else:
                self._state = message
                if self.stopped is None and _is_limp(message):
                    self.stopped = message
            self._changed.notify_all()

    def _wait(self, condition: Callable[[], bool], ask: Callable[[], object]) -> None:
        """Ask until a condition holds.

        Raises:
            TimeoutError: it does not.
        """
        deadline = time.monotonic() + PATIENCE_S
        with self._changed:
            while not condition():
                if time.monotonic() > deadline:
                    raise TimeoutError(f"nothing came of a request in {PATIENCE_S:g} s")
                ask()
                self._changed.wait_for(condition, REPEAT_S)

    def _follows(self) -> bool:
        state = self._state
        return state is not None and state.guard is GuardMode.ACTIVE and not state.fallen

    def raise_up(self) -> None:
        """Clear the stop if there is one, reset, and wait until the controller is followed."""
        self._wait(
            lambda: self._status is not None and self._status.guard is not GuardMode.ESTOP,
            lambda: (
                self._status
                and self._clear.send(EstopClear(reason="bench", stops=max(1, self._status.stops)))
            ),
        )
        self._wait(
            self._follows, lambda: self._request.send(PlantRequest(action=PlantAction.RESET))
        )

    def press(self) -> Stop:
        """Stop the robot.

        Raises:
            TimeoutError: it is not confirmed, or the motors do not become limp.
        """
        button = StopButton()
        with self._changed:
            self._heard = self.stopped = None
        pressed_ns = time.monotonic_ns()
        button.press("benchmark", pressed_ns)
        heard = None
        while True:
            messages = button.poll(time.monotonic_ns(), heard)
            if button.pressed_ns is None:
                break
            for message in messages:
                self._stop.send(message)
            with self._changed:
                self._changed.wait_for(lambda: self._heard is not None, LONGEST_POLL_PERIOD)
                heard, self._heard = self._heard, None
            if time.monotonic_ns() - pressed_ns > PATIENCE_S * 1e9:
                raise TimeoutError("the stop was not confirmed")
        confirmed_ns = time.monotonic_ns()
        with self._changed:
            self._changed.wait_for(lambda: self.stopped is not None, PATIENCE_S)
            state = self.stopped
        if state is None:
            raise TimeoutError("the motors did not become limp")
        return Stop(1e-9 * (state.header.sent - pressed_ns), 1e-9 * (confirmed_ns - pressed_ns))


def measure(stops: int, links: str) -> list[Stop]:
    """Stop a robot ``stops`` times, with the delays and losses of ``links``."""
    found = []
    waits = random.Random(0)
    with running_system(SystemOptions(links=links), None) as running:
        # As every operator; the processes started above have settled their own.
        print(f"scheduling of the button: {enter_realtime(DEFAULT_PRIORITY)}")
        robot = Robot(running.bus)
        try:
            for number in range(stops):
                robot.raise_up()
                time.sleep(waits.uniform(0.2, 0.4))
                found.append(robot.press())
                print(f"{number + 1}/{stops}", end="\r", file=sys.stderr)
            print(f"pictures taken in: {robot.pictures}")
        finally:
            robot.close()
            os.sched_setscheduler(0, os.SCHED_OTHER, os.sched_param(0))
    return found


def show(name: str, stops: list[Stop]) -> None:
    """Print median, 99th percentile and worst."""
    for what, times in zip(Stop._fields, np.array(stops).T * 1e3, strict=True):
        median, p99 = np.percentile(times, (50.0, 99.0))
        print(
            f"{name}, {what}: {len(stops)} stops, median {median:.1f} ms, p99 {p99:.1f} ms, "
            f"worst {times.max():.1f} ms"
        )


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--stops", type=int, default=200, help="stops in each condition (200)")
    arguments = parser.parse_args()
    print(f"load average {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores")
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        for name, links in CONDITIONS.items():
            show(name, measure(arguments.stops, links))
        os.chdir(Path("/"))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
