"""Child processes of an experiment, and the messages that they publish."""

import json
import os
import queue
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Self

from common.schemas import Message
from common.transport.config import BusConfig
from common.transport.session import open_session
from common.transport.tap import RawSample, RawTap
from common.wire.codec import decode
from verification.faults.plan import FaultError

FAULTS = {"killed": signal.SIGKILL, "paused": signal.SIGSTOP, "hung": signal.SIGUSR1}
"""Signals that break a process; only a probe source hangs on the last one."""
TIMEOUT_S = 60.0
"""A process that does not print, write or publish what is expected in this time has failed [s]."""


class Process:
    """Run ``python -m module`` and collect its output line by line.

    A context manager that kills the process on exit. ``TRILL_*`` variables are not inherited.
    """

    def __init__(self, module: str, *arguments: str, prefix: Sequence[str] = ()) -> None:
        """Start the process; ``prefix`` is a command that executes the one that follows it."""
        self.name = module
        self._popen = subprocess.Popen(
            [*prefix, sys.executable, "-m", module, *arguments],
            env={key: value for key, value in os.environ.items() if not key.startswith("TRILL_")},
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.send_signal = self._popen.send_signal
        self._lines: queue.Queue[str] = queue.Queue()
        self._last = ""
        self._reader = threading.Thread(target=self._read, daemon=True)
        self._reader.start()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.kill()

    @property
    def running(self) -> bool:
        """Whether the process has not ended."""
        return self._popen.poll() is None

    def inject(self, fault: str) -> None:
        """Break the process by one of :data:`FAULTS`; any other word leaves it alone."""
        if fault in FAULTS:
            self.send_signal(FAULTS[fault])

    def kill(self) -> None:
        """Kill the process with SIGKILL and wait for its end."""
        self._popen.kill()
        self._popen.wait()

    def expect(self, text: str) -> str:
        """Return the next line that contains ``text``; earlier lines are dropped.

        Raises:
            FaultError: no such line was printed in time.
        """
        deadline = time.monotonic() + TIMEOUT_S
        while (left := deadline - time.monotonic()) > 0.0:
            try:
                line = self._lines.get(timeout=left)
            except queue.Empty:
                break
            if text in line:
                return line
        raise FaultError(f"{self.name} did not print {text!r} within {TIMEOUT_S:g} s")

    def count(self, text: str) -> int:
        """Drop all collected lines; return how many of them contain ``text``."""
        count = 0
        while not self._lines.empty():
            count += text in self._lines.get()
        return count

    def finish(self) -> Any:
        """End the process with SIGTERM and return its last line, read as JSON.

        Raises:
            FaultError: the process did not end in time, or the line is not JSON.
        """
        self.send_signal(signal.SIGTERM)
        self._reader.join(TIMEOUT_S)
        try:
            return json.loads(self._last)
        except json.JSONDecodeError as error:
            raise FaultError(f"{self.name} ended with {self._last[:100]!r}, not JSON") from error

    def _read(self) -> None:
        assert self._popen.stdout is not None
        for line in self._popen.stdout:
            self._last = line
            self._lines.put(line)


class Monitor:
    """Listen to everything on the bus as a passive peer; a context manager."""

    def __init__(self, base_port: int, schemas: Mapping[str, type[Message]]) -> None:
        """Subscribe; ``schemas`` gives the type of the messages to decode by their topic."""
        config = BusConfig(base_port=base_port)
        self._schemas = schemas
        self._session: Any = open_session(config, "monitor")
        self._tap = RawTap(self._session, config.robot)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self._session.close()

    def drain(self) -> list[RawSample]:
        """Return the messages that have arrived and not been taken out yet, undecoded."""
        return self._tap.drain()

    def messages(self) -> Iterator[Any]:
        """Take out and decode the messages that have arrived."""
        for sample in self.drain():
            schema = self._schemas.get(sample.key.partition("/")[2])
            if schema is not None:
                yield decode(sample.payload, schema)

    def listen(self, seconds: float) -> Iterator[Any]:
        """Decode messages as they arrive in the next seconds; earlier ones are dropped."""
        self.drain()
        end = time.monotonic() + seconds
        while time.monotonic() < end:
            yield from self.messages()
            time.sleep(0.02)
