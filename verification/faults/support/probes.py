"""Probe services under the ordinary live runner: a source of traffic and a reader of it.

``python -m verification.faults.support.probes --role source|reader``, with the options of every
service. The source keeps a binary journal of what it sent. The reader prints what its heartbeat
monitor logs, each line after the monotonic time in nanoseconds, and at its end its measurements.
"""

import json
import logging
import signal
import struct
import sys
import time
from argparse import ArgumentParser, Namespace
from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from common.inbox.inbox import Inbox
from common.runtime.live.main import run_live
from common.runtime.service import Inputs, Output, Service
from common.schemas import Message
from common.topics import ALL_TOPICS, ESTOP, PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT, Delivery
from common.transport.publisher import Publisher
from verification.faults.support.messages import (
    OPERATOR_RATES,
    PICTURES,
    ROBOT_RATES,
    message_streams,
)

MODULE = "verification.faults.support.probes"
HANG_S = 0.5
"""Duration of the step in which the source hangs after SIGUSR1 [s]."""
CONNECTED = "first state"
"""Printed by the reader when the first state arrives."""
DEAD, ALIVE = "no sign of life", "alive again"
"""Parts of what the reader's runner logs when a heartbeat stops and when it returns."""
FLUSH_S = 0.1
"""The source's journal is complete up to this long ago [s]."""
_STEP_HZ = 200.0
_RECORD = struct.Struct("<BQQQ")
"""Journal record: index in ALL_TOPICS, sequence number, start and end of the put [ns]."""


class Sent(NamedTuple):
    """A message that was handed to the transport, with start and end of the put [ns, monotonic]."""

    topic: str
    seq: int
    start_ns: int
    end_ns: int


def read_journal(path: Path) -> list[Sent]:
    """Return the sent messages in order; an incomplete last record is ignored."""
    data = path.read_bytes()
    whole = data[: len(data) // _RECORD.size * _RECORD.size]
    return [Sent(ALL_TOPICS[i].name, *values) for i, *values in _RECORD.iter_unpack(whole)]


class Source(Service):
    """Publish a robot's and an operator's traffic; SIGUSR1 hangs the next step."""

    name = "sim"
    period_ns = round(1e9 / _STEP_HZ)
    writes = (*ROBOT_RATES, *OPERATOR_RATES)

    def __init__(self, pictures: str, journal: Path) -> None:
        """Prepare the messages and record every call of :meth:`Publisher.send` from now on."""
        self._streams = message_streams(pictures)
        self._steps_per_message = {
            topic: round(_STEP_HZ / rate) for topic, rate in (ROBOT_RATES | OPERATOR_RATES).items()
        }
        self._steps = 0
        self._hang = False
        signal.signal(signal.SIGUSR1, self._hang_next)
        self._journal = journal.open("wb")
        self._record_puts()

    def step(self, _inputs: Inputs, _now_ns: int) -> Sequence[Output]:
        """Publish the messages that are due."""
        if self._hang:
            self._hang = False
            time.sleep(HANG_S)
        self._steps += 1
        if self._steps % round(FLUSH_S * _STEP_HZ) == 0:
            self._journal.flush()
        return [
            Output(topic, next(stream))
            for topic, stream in self._streams.items()
            if self._steps % self._steps_per_message[topic] == 0
        ]

    def close(self) -> None:
        """Complete the journal."""
        self._journal.flush()

    def _hang_next(self, _number: int, _frame: FrameType | None) -> None:
        self._hang = True

    def _record_puts(self) -> None:
        send, journal = Publisher.send, self._journal
        index = {topic.name: number for number, topic in enumerate(ALL_TOPICS)}

        def recorded(publisher: Publisher[Any], message: Message, captured_ns: int = 0) -> bool:
            seq, start = publisher.sent + publisher.errors, time.monotonic_ns()
            sent = send(publisher, message, captured_ns)
            if sent:
                number = index[publisher.topic.name]
                journal.write(_RECORD.pack(number, seq, start, time.monotonic_ns()))
            return sent

        Publisher.send = recorded  # type: ignore[method-assign,assignment]


class Reader(Service):
    """Measure the age of every message by the clock that it shares with the source."""

    name = "wbc"
    period_ns = 10_000_000
    trigger = PLANT_STATE
    reads = (PLANT_STATE, TELEOP_SETPOINT, TELEOP_GAIT, ESTOP)

    def __init__(self) -> None:
        """Prepare the measurements and print what the heartbeat monitor logs."""
        self._ages: defaultdict[str, list[float]] = defaultdict(list)
        self._state_times: list[int] = []
        self._discarded: dict[str, dict[str, int]] = {}
        logging.getLogger("common.runtime.live.heartbeats").addHandler(_Printer())

    def step(self, inputs: Inputs, now_ns: int) -> Sequence[Output]:
        """Measure the messages that are new."""
        assert isinstance(inputs, Inbox)
        for topic in self.reads:
            new: list[Any] = [inputs.latest(topic)] if inputs.updated(topic) else []
            if topic.delivery is Delivery.EVENT:
                new = inputs.events(topic)
            self._ages[topic.name] += [1e-9 * (now_ns - message.header.sent) for message in new]
            status = inputs.health_of(topic)
            self._discarded[topic.name] = {"stale": status.stale, "skipped": status.skipped}
        if inputs.updated(PLANT_STATE):
            if not self._state_times:
                print(f"{time.monotonic_ns()} {CONNECTED}", flush=True)
            self._state_times.append(now_ns)
        return ()

    def close(self) -> None:
        """Print ages [s] and discarded messages by topic, and the times of the states [ns]."""
        measured = {"ages": self._ages, "discarded": self._discarded, "times": self._state_times}
        print(json.dumps(measured), flush=True)


class _Printer(logging.Handler):
    """Print log messages with the monotonic time [ns]."""

    def emit(self, record: logging.LogRecord) -> None:
        print(f"{time.monotonic_ns()} {record.getMessage()}", flush=True)


def _build(arguments: Namespace) -> Service:
    if arguments.role == "reader":
        return Reader()
    return Source(arguments.pictures, arguments.journal)


def _add_arguments(parser: ArgumentParser) -> None:
    parser.add_argument("--role", choices=["source", "reader"], required=True)
    parser.add_argument("--pictures", choices=PICTURES, default="none", help="source: pictures")
    parser.add_argument("--journal", type=Path, default=Path("/dev/null"), help="source: journal")


if __name__ == "__main__":
    name = Reader.name if "reader" in sys.argv else Source.name
    raise SystemExit(run_live(_build, name, add_arguments=_add_arguments))
