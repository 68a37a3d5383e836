"""Kill the controller of a running system and time the first joint command after its restart."""

import os
import re
import signal
import subprocess
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.builds import Build
from benchmarks.workloads.live import controller_of
from common.schemas import GuardMode, PlantStatus
from common.topics import PLANT_STATUS, WBC_COMMAND
from common.transport.config import BusConfig
from common.transport.session import open_session
from common.transport.tap import RawSample, RawTap
from common.wire.codec import decode
from common.wire.header import wire_header

PATIENCE_S = 60.0
"""The system must be up, and a killed controller back, within this time [s]."""
SETTLE_S = 8.0
"""Default time for which the controller runs undisturbed before it is killed [s]."""


class Recovery(NamedTuple):
    """Result of killing the controller once.

    Attributes:
        seconds: from the kill to the first command of the next controller [s].
        guards: modes that the plant's guard reported in this time.
    """

    seconds: float
    guards: frozenset[GuardMode]


class Observer:
    """Follows commands and the plant's guard on the bus; thread-safe."""

    def __init__(self, base_port: int) -> None:
        # Reconnects quickly, so as to be there when a new controller sends its first command.
        config = BusConfig(base_port=base_port, retry_initial_ms=10, retry_max_ms=20)
        self._changed = threading.Condition()
        self._first_sent: dict[int, int] = {}
        self._guards: list[tuple[int, GuardMode]] = []
        self._session: Any = open_session(config, "bench-start")
        self._command, self._status = (
            f"{config.robot}/{topic.name}" for topic in (WBC_COMMAND, PLANT_STATUS)
        )
        self._tap = RawTap(
            self._session,
            config.robot,
            deliver=self._receive,
            expressions=[self._command, self._status],
        )

    def close(self) -> None:
        """Leave the bus."""
        self._tap.close()
        self._session.close()

    def _receive(self, sample: RawSample) -> None:
        with self._changed:
            if sample.key == self._command:
                header = wire_header(sample.payload)
                if header is not None and header.boot not in self._first_sent:
                    self._first_sent[header.boot] = header.sent
                    self._changed.notify_all()
            else:
                status = decode(sample.payload, PlantStatus)
                self._guards.append((sample.arrival_ns, status.guard))

    def wait_for_controllers(self, count: int) -> int:
        """Wait until ``count`` controllers have sent a command.

        Returns:
            time of the first command of the last one [ns].

        Raises:
            TimeoutError: fewer controllers have sent a command in time.
        """
        with self._changed:
            if not self._changed.wait_for(lambda: len(self._first_sent) >= count, PATIENCE_S):
                raise TimeoutError(f"controller {count} has not commanded in {PATIENCE_S:g} s")
            return max(self._first_sent.values())

    def guards_between(self, begin_ns: int, end_ns: int) -> frozenset[GuardMode]:
        """Return the guard's modes reported in a span of time [ns]."""
        with self._changed:
            return frozenset(mode for at, mode in self._guards if begin_ns <= at <= end_ns)


def restarts(build: Build, kills: int, folder: Path, settle: float = SETTLE_S) -> list[Recovery]:
    """Start a system of ``build`` and kill its controller ``kills`` times.

    Args:
        build: the version of the project that is run.
        kills: number of kills; a supervisor restarts a service three times at most.
        folder: working directory of the system.
        settle: how long a controller runs undisturbed before it is killed [s].

    Raises:
        TimeoutError: a controller did not come up, or not come back.
    """
    results = []
    with _system(build, folder) as (supervisor, port):
        observer = Observer(port)
        try:
            for count in range(1, kills + 1):
                observer.wait_for_controllers(count)
                time.sleep(settle)
                controller = controller_of(supervisor)
                killed_ns = time.monotonic_ns()
                assert controller is not None  # it has just commanded
                os.kill(controller, signal.SIGKILL)
                back_ns = observer.wait_for_controllers(count + 1)
                time.sleep(0.5)  # the plant reports its guard ten times a second
                guards = observer.guards_between(killed_ns, back_ns + 500_000_000)
                results.append(Recovery(1e-9 * (back_ns - killed_ns), guards))
        finally:
            observer.close()
    return results


@contextmanager
def _system(build: Build, folder: Path) -> Iterator[tuple[int, int]]:
    """Run ``trill up`` without cameras and log; yields its process id and base port."""
    command = build.command("up", "--no-cameras", "--no-record")
    output = folder / f"{build.name}.txt"
    with output.open("wb") as stream:
        process = subprocess.Popen(
            command, env=build.environment, cwd=folder, stdout=stream, stderr=stream
        )
    try:
        yield process.pid, _base_port(output, process)
    finally:
        process.terminate()
        process.wait(timeout=PATIENCE_S)


def _base_port(output: Path, process: "subprocess.Popen[bytes]") -> int:
    """Wait for the base port that a system prints.

    Raises:
        RuntimeError: the system ended before it had one.
        TimeoutError: it printed none in time.
    """
    deadline = time.monotonic() + PATIENCE_S
    while time.monotonic() < deadline:
        text = output.read_text(encoding="utf-8", errors="replace")
        if found := re.search(r"base port (\d+)", text):
            return int(found[1])
        if process.poll() is not None:
            raise RuntimeError(f"the system did not start: {text}")
        time.sleep(0.05)
    raise TimeoutError(f"the system has printed no base port in {PATIENCE_S:g} s")
