"""Round trips of a PlantState's bytes to an echo process and back, by three ways.

- typed: stamp, encode, Zenoh, inbox, decode and check; the echo decodes and encodes again;
- zenoh: the same bytes and the same hand-over between threads, without looking at them;
- tcp: a socket without delay, blocking reads.

They take turns, one of each kind (in blocks of 50 when back to back), so that whatever else the
machine does meets all kinds alike. ``round_trips.py KIND PORT`` is the echo process, which inherits
scheduling and import path of the process that starts it.

    python benchmarks/workloads/round_trips.py [ROUNDS]

Results, back to back and with the scheduling of the services: ``typed_us``, ``zenoh_us`` and
``tcp_us``, medians.
"""

import gc
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.runtime.live.realtime import DEFAULT_PRIORITY, enter_realtime
from common.schemas import Header, PlantState
from common.topics import PLANT_STATE, PLANT_TRUTH, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from common.wire.codec import encode

ROBOT = "bench"
TIMEOUT_S = 20.0
ROUNDS = 3000
BLOCK = 50
"""Back to back, this many of one kind before the next kind."""
RAW_PING, RAW_PONG = f"{ROBOT}/raw/ping", f"{ROBOT}/raw/pong"
HEADER = Header(seq=1, stamp=1, sent=1, boot=1, source="bench")

RoundTrip = Callable[[], None]


def plant_state() -> PlantState:
    """Return a state with random numbers."""
    rng = np.random.default_rng(0)
    return PlantState(
        base_position=rng.normal(size=3),
        base_quaternion=np.array([1.0, 0.0, 0.0, 0.0]),
        base_linear_velocity=rng.normal(size=3),
        base_angular_velocity=rng.normal(size=3),
        joint_position=rng.normal(size=27),
        joint_velocity=rng.normal(size=27),
        joint_torque=rng.normal(size=27),
        gripper_closure=rng.uniform(size=2),
        foot_normal_force=rng.uniform(size=2),
    )


class TypedEnd:
    """A publisher and an inbox; :meth:`receive` waits for the next message."""

    def __init__(
        self, name: str, base_port: int, send: Topic[PlantState], read: Topic[PlantState]
    ) -> None:
        self.session: Any = open_session(BusConfig(robot=ROBOT, base_port=base_port), name)
        self.inbox = Inbox((read,), trigger=read)
        self._read = read
        self._subscribers = subscribe(self.session, ROBOT, self.inbox, (read,))
        self.publisher = Publisher(self.session, ROBOT, send, name, 1)

    def receive(self, timeout_s: float) -> PlantState | None:
        """Return the next message; None if none comes in time."""
        if not self.inbox.wait(timeout_s):
            return None
        now = time.monotonic_ns()
        self.inbox.trigger_arrival(now)
        self.inbox.begin_step(now)
        return self.inbox.latest(self._read) if self.inbox.updated(self._read) else None


class RawEnd:
    """The same over plain Zenoh, with the same hand-over to the waiting thread."""

    def __init__(self, name: str, base_port: int, send: str, read: str) -> None:
        import zenoh

        self.session: Any = open_session(BusConfig(robot=ROBOT, base_port=base_port), name)
        self._event = threading.Event()
        self._payload = b""
        self.publisher: Any = self.session.declare_publisher(
            send,
            priority=zenoh.Priority.REAL_TIME,
            express=True,
            congestion_control=zenoh.CongestionControl.DROP,
        )
        self._subscriber: Any = self.session.declare_subscriber(read, self._receive)

    def _receive(self, sample: Any) -> None:
        self._payload = sample.payload.to_bytes()
        self._event.set()

    def receive(self, timeout_s: float) -> bytes | None:
        """Return the next payload; None if none comes in time."""
        if not self._event.wait(timeout_s):
            return None
        self._event.clear()
        return self._payload


def echo(kind: str, port: int) -> None:
    """Answer until killed, or until the connection ends."""
    if kind == "typed":
        typed = TypedEnd("wbc", port, PLANT_TRUTH, PLANT_STATE)
        while True:
            message = typed.receive(1.0)
            if message is not None:
                typed.publisher.send(message)
    if kind == "zenoh":
        raw = RawEnd("wbc", port, RAW_PONG, RAW_PING)
        while True:
            payload = raw.receive(1.0)
            if payload is not None:
                raw.publisher.put(payload)
    with socket.create_connection(("127.0.0.1", port)) as connection:
        connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        while data := connection.recv(65536):
            connection.sendall(data)


def typed_round_trip(port: int) -> tuple[RoundTrip, Callable[[], None]]:
    """Return one typed round trip as a function, and what closes it."""
    end = TypedEnd("sim", port, PLANT_STATE, PLANT_TRUTH)
    message = plant_state()

    def go() -> None:
        end.publisher.send(message)
        if end.receive(TIMEOUT_S) is None:
            raise TimeoutError("no typed echo")

    give_up = time.monotonic() + TIMEOUT_S
    while not (end.publisher.send(message) and end.receive(0.1)):
        if time.monotonic() > give_up:
            raise TimeoutError("no typed echo")
    return go, end.session.close


def raw_round_trip(port: int, payload: bytes) -> tuple[RoundTrip, Callable[[], None]]:
    """Return one round trip over plain Zenoh, and what closes it."""
    end = RawEnd("sim", port, RAW_PING, RAW_PONG)

    def go() -> None:
        end.publisher.put(payload)
        if end.receive(TIMEOUT_S) is None:
            raise TimeoutError("no echo over plain Zenoh")

    give_up = time.monotonic() + TIMEOUT_S
    end.publisher.put(payload)
    while end.receive(0.1) is None:
        if time.monotonic() > give_up:
            raise TimeoutError("no echo over plain Zenoh")
        end.publisher.put(payload)
    return go, end.session.close


def tcp_round_trip(server: socket.socket, payload: bytes) -> tuple[RoundTrip, Callable[[], None]]:
    """Return one round trip over TCP, and what closes it."""
    connection, _ = server.accept()
    connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def go() -> None:
        connection.sendall(payload)
        missing = len(payload)
        while missing:
            missing -= len(connection.recv(missing))

    return go, connection.close


def measure_round_trips(rounds: int, rate: float) -> dict[str, list[int]]:
    """Print medians, 99th percentiles and ratios of the three kinds.

    Returns:
        the times by kind [ns].
    """
    payload = encode(plant_state(), HEADER)
    server = socket.create_server(("127.0.0.1", 0))
    base = server.getsockname()[1] % 20_000 + 30_000
    ports = {"typed": base, "zenoh": base + 16, "tcp": server.getsockname()[1]}
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    command = [sys.executable, str(Path(__file__).resolve())]
    echoes = [
        subprocess.Popen([*command, kind, str(port)], env=environment)
        for kind, port in ports.items()
    ]
    closers: list[Callable[[], None]] = [server.close]
    try:
        kinds = {
            "typed": typed_round_trip(ports["typed"]),
            "zenoh": raw_round_trip(ports["zenoh"], payload),
            "tcp": tcp_round_trip(server, payload),
        }
        closers += [close for _, close in kinds.values()]
        times: dict[str, list[int]] = {kind: [] for kind in kinds}
        block = 1 if rate else BLOCK
        for _ in range(max(1, rounds // block)):
            for kind, (go, _) in kinds.items():
                for _ in range(block):
                    start = time.perf_counter_ns()
                    go()
                    times[kind].append(time.perf_counter_ns() - start)
                    if rate:
                        time.sleep(1.0 / rate)
    finally:
        for close in closers:
            close()
        for process in echoes:
            process.kill()
            process.wait()
    pace = f"one at a time at {rate:g} Hz, caches cold" if rate else "back to back"
    print(f"round trip of {len(payload)} bytes, {len(times['tcp'])} of each kind, {pace}")
    report(times)
    return times


def report(times: dict[str, list[int]]) -> None:
    """Print one line a kind, with its ratio to plain Zenoh."""
    reference = np.percentile(times["zenoh"], [50, 99])
    for kind, samples in times.items():
        middle, p99 = np.percentile(samples, [50, 99])
        print(
            f"  {kind:6s} median {middle / 1e3:7.1f} us   p99 {p99 / 1e3:8.1f} us   "
            f"x{middle / reference[0]:.2f} / x{p99 / reference[1]:.2f} of plain zenoh"
        )


def main() -> int:
    """Echo, or measure and print the result."""
    gc.disable()  # as the live runner does during steps
    if len(sys.argv) == 3:
        echo(sys.argv[1], int(sys.argv[2]))
        return 0
    enter_realtime(DEFAULT_PRIORITY)
    times = measure_round_trips(int(sys.argv[1]) if len(sys.argv) == 2 else ROUNDS, 0.0)
    print(json.dumps({f"{kind}_us": 1e-3 * median(samples) for kind, samples in times.items()}))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
