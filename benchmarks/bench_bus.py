"""What the typed bus costs: round trips against raw Zenoh and raw TCP, codec, simulated time.

Round trips go to an echo process and back on loopback with the bytes of a PlantState, one of each
kind in turn (in blocks of 50 when back to back), so that whatever else the machine does meets all
kinds alike:

- typed: stamp, encode, Zenoh, inbox, decode and check; the echo decodes and encodes again;
- zenoh: the same bytes and the same hand-over between threads, nothing looked at;
- tcp: a socket without delay, blocking reads.

    python benchmarks/bench_bus.py [--rounds N] [--rate HZ]
"""

import argparse
import gc
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.links.delay import DelayLine
from common.links.spec import LinkSpec
from common.runtime.live.realtime import enter_realtime
from common.runtime.service import Inputs, Output, Service
from common.runtime.simulated.runner import SimTimeRunner
from common.schemas import CameraFrame, Header, JointCommand, Message, PlantState
from common.topics import CAMERA_LEFT, PLANT_STATE, PLANT_TRUTH, WBC_COMMAND, Topic
from common.transport.config import BusConfig
from common.transport.publisher import Publisher
from common.transport.session import open_session
from common.wire.codec import decode, encode

ROBOT = "bench"
TIMEOUT_S = 20.0
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


def joint_command() -> JointCommand:
    """Return a command with random numbers."""
    rng = np.random.default_rng(1)
    names = ("position", "velocity", "acceleration", "torque", "stiffness", "damping")
    return JointCommand(
        gripper_closure=np.zeros(2),
        **{name: rng.normal(size=27) for name in names},  # type: ignore[arg-type]
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
    """Answer until killed."""
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


def measure_round_trips(rounds: int, rate: float) -> None:
    """Print medians, 99th percentiles and ratios of the three kinds."""
    payload = encode(plant_state(), HEADER)
    server = socket.create_server(("127.0.0.1", 0))
    base = server.getsockname()[1] % 20_000 + 30_000
    ports = {"typed": base, "zenoh": base + 16, "tcp": server.getsockname()[1]}
    root = Path(__file__).resolve().parents[1]
    environment = os.environ | {"PYTHONPATH": str(root)}
    command = [sys.executable, str(Path(__file__).resolve()), "--echo"]
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


def report(times: dict[str, list[int]]) -> None:
    """Print one line a kind, with its ratio to plain Zenoh."""
    reference = np.percentile(times["zenoh"], [50, 99])
    for kind, samples in times.items():
        median, p99 = np.percentile(samples, [50, 99])
        print(
            f"  {kind:6s} median {median / 1e3:7.1f} us   p99 {p99 / 1e3:8.1f} us   "
            f"x{median / reference[0]:.2f} / x{p99 / reference[1]:.2f} of plain zenoh"
        )


def best_us(function: Callable[[], object], repeats: int = 200, number: int = 100) -> float:
    """Return the shortest time of one call [us], the least disturbed by other work."""
    best = float("inf")
    for _ in range(repeats):
        start = time.perf_counter_ns()
        for _ in range(number):
            function()
        best = min(best, (time.perf_counter_ns() - start) / number)
    return best / 1e3


def measure_codec() -> None:
    """Print what encoding and decoding cost."""
    image = CameraFrame(eye="left", width=640, height=360, encoding="jpeg", data=bytes(30_000))
    messages: Sequence[tuple[Topic[Any], Message]] = (
        (PLANT_STATE, plant_state()),
        (WBC_COMMAND, joint_command()),
        (CAMERA_LEFT, image),
    )
    print("codec, best of 200 runs")
    for topic, message in messages:
        payload = encode(message, HEADER)
        there = best_us(lambda message=message: encode(message, HEADER))  # type: ignore[misc]
        back = best_us(lambda p=payload, s=topic.schema: decode(p, s))  # type: ignore[misc]
        print(
            f"  {type(message).__name__:13s} {len(payload):6d} bytes   encode {there:6.1f} us   "
            f"decode and check {back:6.1f} us"
        )


class Idle(Service):
    """Reads what the plant reads and does nothing, every millisecond."""

    name = "sim"
    period_ns = 1_000_000
    reads = (WBC_COMMAND,)

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Do nothing."""
        return ()


def measure_runner_and_delay() -> None:
    """Print the overhead of simulated time and of the delay line."""
    runner = SimTimeRunner([Idle()])
    per_step = best_us(lambda: runner.run_for(1.0), repeats=10, number=1) / 1000
    line: DelayLine[int] = DelayLine(LinkSpec.parse("lognormal(122ms, 190ms)"))
    clock = iter(range(0, 10**15, 5_000_000))

    def through() -> None:
        now = next(clock)
        line.push(0, now)
        line.pop(now)

    print(
        f"simulated time: {per_step:.2f} us per step when nothing arrives; delay line: "
        f"{best_us(through, repeats=50):.1f} us per message"
    )


def main() -> int:
    """Measure everything and print it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=3000, help="round trips of each kind")
    parser.add_argument("--rate", type=float, default=200.0, help="pace of the paced run [Hz]")
    parser.add_argument("--echo", nargs=2, metavar=("KIND", "PORT"), help=argparse.SUPPRESS)
    parser.add_argument(
        "--rt-priority", type=int, default=20, help="SCHED_FIFO as the services; 0 for none"
    )
    arguments = parser.parse_args()
    scheduling = enter_realtime(arguments.rt_priority)
    gc.disable()  # as the live runner does during steps
    if arguments.echo:
        echo(arguments.echo[0], int(arguments.echo[1]))
        return 0
    print(f"scheduling: {scheduling}")
    measure_round_trips(arguments.rounds, 0.0)
    measure_round_trips(max(1, arguments.rounds // 10), arguments.rate)
    measure_codec()
    measure_runner_and_delay()
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
