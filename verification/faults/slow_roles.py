"""The processes of :mod:`verification.faults.slow_subscriber`: a publisher and its readers."""

import json
import sys
import time
from typing import Any

from common.runtime.live.realtime import DEFAULT_PRIORITY, enter_realtime
from common.runtime.live.stopping import StopSignals
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_STATE, WBC_COMMAND, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import new_boot_id, open_session
from common.transport.tap import RawTap
from verification.faults.robot_load import make_messages

ROBOT = "faults"
TICK_S = 0.005
READY = "ready"

_EVERY: tuple[tuple[Topic[Any], int], ...] = (
    (PLANT_STATE, 1),
    (WBC_COMMAND, 2),
    (CAMERA_LEFT, 10),
    (CAMERA_RIGHT, 10),
)
"""Topic, and in which of how many ticks it is sent."""


def publish(config: BusConfig) -> None:
    """Send what a robot sends until a signal; then print how long each put took, as JSON.

    Each row: topic's number in the table, start [ns, monotonic], duration [ns].
    """
    stop = StopSignals().install()
    scheduling = enter_realtime(DEFAULT_PRIORITY)
    session: Any = open_session(config, "sim")
    boot, rows, what = new_boot_id(), [], make_messages("jpeg")
    publishers = {topic.name: Publisher(session, ROBOT, topic, "sim", boot) for topic, _ in _EVERY}
    print(READY, flush=True)
    due, tick = time.monotonic(), 0
    while not stop.requested:
        for number, (topic, every) in enumerate(_EVERY):
            if tick % every == 0:
                started = time.monotonic_ns()
                publishers[topic.name].send(what[topic.name][0])
                rows.append((number, started, time.monotonic_ns() - started))
        tick += 1
        due += TICK_S
        time.sleep(max(0.0, due - time.monotonic()))
    session.close()
    json.dump({"scheduling": scheduling, "rows": rows}, sys.stdout)


def read(config: BusConfig, nap_s: float) -> None:
    """Read everything until a signal, after each message asleep for a while; print the counts."""
    stop = StopSignals().install()
    session: Any = open_session(config, "reader")
    if nap_s > 0.0:
        subscriber = session.declare_subscriber(f"{ROBOT}/**", lambda _: time.sleep(nap_s))
        print(READY, flush=True)
        while not stop.requested:
            time.sleep(0.05)
        subscriber.undeclare()
        session.close()
        return
    tap = RawTap(session, ROBOT)
    print(READY, flush=True)
    arrivals: list[int] = []
    while not stop.requested:
        arrivals += [s.arrival_ns for s in tap.drain() if s.key.endswith(PLANT_STATE.name)]
        time.sleep(0.02)
    session.close()
    json.dump(arrivals, sys.stdout)
