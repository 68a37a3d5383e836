"""Cut the network between two hosts and judge what is applied when it comes back.

Source and reader run in two Linux network namespaces joined by a virtual cable (veth), which is
set down and up again. Nothing is lost in the machine itself: what waited in the transport's queues
arrives late, as after a gap of a radio link. Needs root.
"""

import contextlib
import secrets
import subprocess
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from pydantic import Field

from common.topics import ESTOP, PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT
from verification.faults.plan import FaultError, FaultPlan, Progress, Promise, Row
from verification.faults.support import probes
from verification.faults.support.probes import read_journal
from verification.faults.support.process import Process

PORT = 24448
ADDRESS, READER_ADDRESS = "10.231.77.1", "10.231.77.2"
STEP_S = 0.03
"""Longest time from arrival to the reader's step, which measures the ages [s]."""
SETTLE_S = 3.0
RECOVERY_S = 5.0
"""The reader is watched for this long after the cable is back [s]."""
AGED = (PLANT_STATE, TELEOP_SETPOINT, TELEOP_GAIT)
"""Topics whose messages are discarded when they are too old on arrival."""


class NetworkCut(FaultPlan):
    """Cut the network once for each length."""

    name = "network_cut"
    setup = "a source and a reader in two network namespaces joined by a virtual cable"
    fault = "the cable is set down for 0.5 to 5 s"
    recovery = "states come in again; late messages are discarded, except emergency stops"
    promises = (
        Promise("no stale message is applied", "applied too old", 0),
        Promise("states are back soon after the network", "back after [s]", RECOVERY_S),
    )
    quick: ClassVar = {"cuts": (0.5, 2.0)}

    cuts: tuple[float, ...] = Field(
        default=(0.5, 1.0, 2.0, 5.0), min_length=1, description="lengths of the cuts [s]"
    )

    def measure(self, progress: Progress) -> Iterator[Row]:
        """Yield a row for each cut; see the base class."""
        for seconds in self.cuts:
            progress(f"cut of {seconds:g} s")
            yield _cut(seconds)


def _cut(seconds: float) -> Row:
    endpoint = f"tcp/{ADDRESS}:{PORT}"
    to_source, to_nobody = ("--listen", endpoint, "--connect", ""), "tcp/127.0.0.1:0"
    with (
        tempfile.NamedTemporaryFile() as journal,
        _network() as (near, far, cable),
        _probe(near, "source", *to_source, "--journal", journal.name),
        _probe(far, "reader", "--listen", to_nobody, "--connect", endpoint) as reader,
    ):
        reader.expect(probes.CONNECTED)
        time.sleep(SETTLE_S)
        _ip("-n", near, "link", "set", cable, "down")
        time.sleep(seconds)
        _ip("-n", near, "link", "set", cable, "up")
        up_ns = time.monotonic_ns()
        time.sleep(RECOVERY_S)
        seen = reader.finish()
        puts = [1e-6 * (one.end_ns - one.start_ns) for one in read_journal(Path(journal.name))]
    return {
        "cut [s]": seconds,
        **_findings(seen, up_ns),
        "put p99 [ms]": float(np.percentile(puts, 99)),
        "put max [ms]": max(puts),
    }


def _findings(seen: Any, up_ns: int) -> dict[str, float]:
    ages, discarded = seen["ages"], [seen["discarded"][topic.name] for topic in AGED]
    stops = ages.get(ESTOP.name, [])
    returned = min((at for at in seen["times"] if at > up_ns), default=float("inf"))
    return {
        "stale": sum(counts["stale"] for counts in discarded),
        "skipped": sum(counts["skipped"] for counts in discarded),
        "applied too old": sum(
            age > topic.max_age + STEP_S for topic in AGED for age in ages.get(topic.name, [])
        ),
        "old stops applied": sum(age > 0.5 for age in stops),
        "oldest stop [s]": max(stops, default=0.0),
        "oldest gait [s]": max(ages.get(TELEOP_GAIT.name, []), default=0.0),
        "back after [s]": 1e-9 * (returned - up_ns),
    }


def _probe(namespace: str, role: str, *options: str) -> Process:
    prefix = ("ip", "netns", "exec", namespace)
    return Process(probes.MODULE, "--role", role, *options, prefix=prefix)


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


@contextlib.contextmanager
def _network() -> Iterator[tuple[str, str, str]]:
    """Yield two connected network namespaces and the name of the cable's end in the first.

    Raises:
        FaultError: namespaces are not permitted, or there is no ``ip``.
    """
    tag = secrets.token_hex(3)
    near, far, cable, other = f"trill-{tag}-a", f"trill-{tag}-b", f"tr{tag}a", f"tr{tag}b"
    try:
        try:
            _ip("netns", "add", near)
            _ip("netns", "add", far)
            _ip("link", "add", cable, "netns", near, "type", "veth", "peer", other, "netns", far)
        except (OSError, subprocess.CalledProcessError) as error:
            text = getattr(error, "stderr", None) or str(error)
            raise FaultError(f"needs root, `ip` and network namespaces: {text.strip()}") from error
        for namespace, link, address in ((near, cable, ADDRESS), (far, other, READER_ADDRESS)):
            _ip("-n", namespace, "addr", "add", f"{address}/24", "dev", link)
            _ip("-n", namespace, "link", "set", link, "up")
            _ip("-n", namespace, "link", "set", "lo", "up")
        yield near, far, cable
    finally:
        for namespace in (near, far):
            subprocess.run(["ip", "netns", "del", namespace], check=False, capture_output=True)
