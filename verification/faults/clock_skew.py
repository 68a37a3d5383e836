"""Shift a host's clock, or set it while it runs, and compare the estimated offset with the truth.

A source with a shifted monotonic clock sends to a reader. The kernel's clock is shifted where time
namespaces are permitted (root), otherwise Python's; a step is always Python's, since no kernel sets
its monotonic clock. The table shows what the reader's health message says: clock offset and bound,
the latency of the wire corrected by it, and how many states were discarded as stale.
"""

import signal
import time
from collections.abc import Iterator
from itertools import takewhile
from typing import ClassVar, NamedTuple

from pydantic import Field

from common.schemas import LinkHealth, PeerHealth, ServiceHealth
from common.topics import PLANT_STATE
from deploy.ports import reserve_base_port
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support import clock_shim, probes
from verification.faults.support.process import TIMEOUT_S, Monitor, Process

WATCH_S = 6.0
"""The reader is watched for this long, and for as long again after a step [s]."""
NEVER = "1e6"


class ClockSkew(FaultPlan):
    """Run source and reader once for each error of the clock."""

    name = "clock_skew"
    setup = "a source and a reader as processes under the live runner"
    fault = "the source's monotonic clock is ahead, behind, or set while it runs"
    recovery = "the reader estimates the offset within its bound and goes on"
    promises = (
        Promise("the true clock offset is within the estimate's bound", "outside bound", 0),
        Promise("no state counts as stale while a clock is off", "stale", 0, {"clock": "off"}),
    )
    quick: ClassVar = {"skews": (0.2, -0.2), "steps": (0.15,)}

    skews: tuple[float, ...] = Field(
        default=(0.0, 0.2, -0.2), min_length=1, description="the source's clock is ahead by [s]"
    )
    steps: tuple[float, ...] = Field(
        default=(0.15, -0.15), description="the source's clock is set forward while it runs [s]"
    )

    def measure(self, progress: Progress) -> Iterator[Row]:
        """Yield a row for each error of the clock; see the base class."""
        kernel = clock_shim.has_time_namespaces()
        errors = [(skew, 0.0) for skew in self.skews] + [(0.0, step) for step in self.steps]
        with reserve_base_port() as port:
            for skew, step in errors:
                progress(f"clock ahead by {skew:g} s, then set by {step:g} s")
                yield _observe(port, skew, step, kernel and not step)


class Seen(NamedTuple):
    """What a health message of the reader says about the source, and when it came [s]."""

    at: float
    peer: PeerHealth
    link: LinkHealth

    def fits(self, truth: float) -> bool:
        """Whether a clock that is ahead by ``truth`` [s] is within the bound of the estimate."""
        return abs(self.peer.clock_offset + truth) <= self.peer.clock_error + 1e-9


def _observe(port: int, skew: float, step: float, kernel: bool) -> Row:
    """Watch a source whose clock is off; if there is a step, set the clock and watch on."""
    shift = ["--skew", str(skew), "--step", str(step), "--after", NEVER]
    role, base = ("--", probes.MODULE, "--role", "source"), ("--base-port", str(port))
    with (
        Process(clock_shim.MODULE, *shift, *["--namespace"] * kernel, *role, *base) as source,
        Process(probes.MODULE, "--role", "reader", *base),
        Monitor(port, {f"health/{probes.Reader.name}": ServiceHealth}) as monitor,
    ):
        health = _health(monitor)
        seen = _until(next(health).at + WATCH_S, health)
        held, stale, times = all(one.fits(skew) for one in seen), seen[-1].link.stale, {}
        if step:
            source.send_signal(signal.SIGUSR2)
            set_at = time.monotonic()
            adopted = (
                one.at for one in health if abs(one.peer.clock_offset + step) < abs(step) / 2
            )
            times = {"adopted after [s]": next(adopted) - set_at}
            seen = _until(set_at + WATCH_S, health)
            held, stale = seen[-1].fits(step), seen[-1].link.stale - stale
    peer, link, truth = seen[-1].peer, seen[-1].link, skew + step
    wire = next((stage for stage in link.stages if stage.stage == "wire"), None)
    return {
        "clock": "set" if step else "off",
        "by": "kernel" if kernel else "Python",
        "ahead [ms]": 1e3 * truth,
        "offset found [ms]": 1e3 * peer.clock_offset,
        "bound [ms]": 1e3 * peer.clock_error,
        "off by [ms]": 1e3 * abs(peer.clock_offset + truth),
        "wire p50 [ms]": float("nan") if wire is None else 1e3 * wire.median,
        "wire p99 [ms]": float("nan") if wire is None else 1e3 * wire.p99,
        "outside bound": int(not held),
        "stale": stale,
        **times,
    }


def _health(monitor: Monitor) -> Iterator[Seen]:
    for health in monitor.listen(TIMEOUT_S):
        peers = [p for p in health.peers if p.source == "sim" and p.clock_error >= 0.0]
        links = [link for link in health.links if link.topic == PLANT_STATE.name]
        if peers and links and links[0].stages:
            yield Seen(time.monotonic(), peers[0], links[0])
    raise FaultError(f"the reader did not find the source's clock within {TIMEOUT_S:g} s")


def _until(end: float, health: Iterator[Seen]) -> list[Seen]:
    return list(takewhile(lambda seen: seen.at <= end, health))
