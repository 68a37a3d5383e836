"""Pause, slow down or kill a subscriber and measure what sending costs the publisher.

One process sends a robot's full traffic, one healthy reader takes it, and a second reader is in
turn healthy and faulty, attached as a peer or as a client of the router. The conditions take turns
within one run, so that other load of the machine affects all of them alike.
"""

import tempfile
import time
from collections import defaultdict
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import ClassVar

import numpy as np
import numpy.typing as npt
from pydantic import Field

from common.ports import PORT_OFFSETS, ROUTER_OFFSET
from common.topics import CAMERA_LEFT, CAMERA_RIGHT, PLANT_STATE, WBC_COMMAND
from deploy.ports import reserve_base_port
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support import probes, slow_reader
from verification.faults.support.probes import Sent, read_journal
from verification.faults.support.process import TIMEOUT_S, Monitor, Process

NAP_S = 0.02
"""A slow reader sleeps for this long after each message [s]."""
SETTLE_S = 1.0
FAULTS = ("paused", "slow", "killed")
ROUTES = ("peer", "client")
MESSAGES = {
    PLANT_STATE.name: "state",
    WBC_COMMAND.name: "command",
    CAMERA_LEFT.name: "picture",
    CAMERA_RIGHT.name: "picture",
}
STATES, PICTURES = {"message": "state"}, {"message": "picture"}

Window = tuple[int, int]
"""Start and end of a condition [ns, monotonic]."""


class SlowSubscriber(FaultPlan):
    """Let a second reader be healthy and faulty in turn."""

    name = "slow_subscriber"
    setup = "a source of full traffic, a router, a healthy reader and a second one (peer, client)"
    fault = "the second reader is paused (SIGSTOP), slow (20 ms a message) or killed (SIGKILL)"
    recovery = "the source sends as fast as beside a healthy second reader"
    promises = (
        Promise("sending a state takes less than twice as long", "p99 ratio", 2.0, STATES),
        Promise("a picture is held up for at most 3 ms", "p99 [µs]", 3000.0, PICTURES),
    )
    quick: ClassVar = {"rounds": 1, "seconds": 3.0}

    rounds: int = Field(default=3, ge=1, description="times each condition")
    seconds: float = Field(default=6.0, gt=0.0, description="length of each condition [s]")

    def measure(self, progress: Progress) -> list[Row]:
        """Return a row for each condition and kind of message; see the base class."""
        windows: defaultdict[str, list[Window]] = defaultdict(list)
        arrivals: list[int] = []
        with (
            tempfile.NamedTemporaryFile() as journal,
            reserve_base_port() as port,
            Process(
                *(probes.MODULE, "--role", "source", "--pictures", "jpeg"),
                *("--journal", journal.name, "--base-port", str(port)),
            ),
            Process("deploy.router", "--base-port", str(port)),
            Monitor(port, {PLANT_STATE.name: PLANT_STATE.schema}) as healthy,
        ):
            if next(healthy.listen(TIMEOUT_S), None) is None:
                raise FaultError("the source sends no states")
            time.sleep(SETTLE_S)
            healthy.drain()
            turns = [
                (route, condition)
                for _ in range(self.rounds)
                for route in ROUTES
                for fault in FAULTS
                for condition in ("healthy", fault)
            ]
            for number, (route, condition) in enumerate(turns, 1):
                progress(f"{number} of {len(turns)}: {route} {condition}")
                window = _run_beside(port, route, condition, self.seconds)
                windows[f"{route} {condition}"].append(window)
                samples = [s for s in healthy.drain() if s.key.endswith(PLANT_STATE.name)]
                arrivals += [sample.arrival_ns for sample in samples]
            time.sleep(5.0 * probes.FLUSH_S)
            return summarise(windows, read_journal(Path(journal.name)), arrivals)


def _run_beside(port: int, route: str, condition: str, seconds: float) -> Window:
    """Attach a second reader, healthy or faulty; return the time in which it was."""
    offset = PORT_OFFSETS[probes.Source.name] if route == "peer" else ROUTER_OFFSET
    endpoint, nap = f"tcp/127.0.0.1:{port + offset}", NAP_S if condition == "slow" else 0.0
    options = ("--mode", route, "--connect", endpoint, "--nap", str(nap))
    with Process(slow_reader.MODULE, *options) as reader:
        reader.expect(slow_reader.READY)
        time.sleep(SETTLE_S)
        started = time.monotonic_ns()
        reader.inject(condition)
        time.sleep(seconds)
        return started, time.monotonic_ns()


def summarise(
    windows: Mapping[str, Sequence[Window]], sent: Sequence[Sent], arrivals: Sequence[int]
) -> list[Row]:
    """Compare the duration of a put with that beside a healthy reader on the same route.

    Args:
        windows: times of each condition, ``<route> <condition>``.
        sent: the generator's journal.
        arrivals: arrival times of the states at the healthy reader [ns].
    """
    starts = np.array([one.start_ns for one in sent])
    puts_us = np.array([1e-3 * (one.end_ns - one.start_ns) for one in sent])
    kinds = np.array([MESSAGES.get(one.topic, "") for one in sent])
    rows: list[Row] = []
    for reader, spans in windows.items():
        inside, reference = (
            _within(starts, windows[name]) for name in (reader, f"{reader.split()[0]} healthy")
        )
        for kind in dict.fromkeys(MESSAGES.values()):
            puts = puts_us[inside & (kinds == kind)]
            p50, p99 = np.percentile(puts, [50, 99])
            row: dict[str, str | int | float] = {
                "reader": reader,
                "message": kind,
                "sent": len(puts),
                "put p50 [µs]": float(p50),
                "p99 [µs]": float(p99),
                "max [µs]": float(puts.max()),
                "p99 ratio": float(p99 / np.percentile(puts_us[reference & (kinds == kind)], 99)),
            }
            if kind == "state":
                received = int(_within(np.array(arrivals), spans).sum())
                row["missed by healthy reader"] = len(puts) - received
            rows.append(row)
    return rows


def _within(times: npt.NDArray[np.int64], spans: Sequence[Window]) -> npt.NDArray[np.bool_]:
    inside = np.zeros(len(times), bool)
    for start, end in spans:
        inside |= (times >= start) & (times < end)
    return inside
