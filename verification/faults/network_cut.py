"""``python -m verification.faults.network_cut``: a real network goes away and comes back.

Source and reader run in two Linux network namespaces joined by a virtual cable (veth), which is
pulled and put back; nothing is lost in the machine itself, and what waited in the transport's
queues arrives late, as after the gap of a radio link. Counted is what was too old when it arrived
and what was applied all the same (must be none; emergency stops must be), what handing over cost
the publisher, and how long after the cable is back states are taken in again. Needs root.
"""

import argparse
import contextlib
import json
import os
import secrets
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from common.topics import ESTOP, PLANT_STATE, TELEOP_GAIT, TELEOP_SETPOINT
from verification.faults.beacons import HEARD

ADDRESS, PORT = "10.231.77.1", 24448
READER_ADDRESS = "10.231.77.2"
STEP_S = 0.03
"""From arriving to being looked at by the reader's step, which notes ages [s]."""
SETTLE_S = 3.0
PATIENCE_S = 60.0


@dataclass(frozen=True)
class Result:
    """What one cut did."""

    cut_s: float
    stale: int
    let_go: int
    applied_too_old: int
    stops: int
    oldest_stop_s: float
    oldest_gait_s: float
    gap_s: float
    resumed_s: float
    put_p99_ms: float
    put_max_ms: float


def _ip(*words: str) -> None:
    subprocess.run(["ip", *words], check=True, capture_output=True, text=True)


@contextlib.contextmanager
def _network() -> Iterator[tuple[str, str, str]]:
    """Two namespaces and the cable's name in the first; all of it gone at the end.

    Raises:
        SystemExit: not permitted, or there is no ``ip``.
    """
    tag = secrets.token_hex(3)
    near, far = f"trill-{tag}-a", f"trill-{tag}-b"
    cable, other = f"tr{tag}a", f"tr{tag}b"
    try:
        try:
            _ip("netns", "add", near)
            _ip("netns", "add", far)
            _ip("link", "add", cable, "netns", near, "type", "veth", "peer", other, "netns", far)
        except (OSError, subprocess.CalledProcessError) as error:
            text = getattr(error, "stderr", None) or str(error)
            raise SystemExit(f"needs root, `ip` and network namespaces: {text.strip()}") from error
        for space, link, address in ((near, cable, ADDRESS), (far, other, READER_ADDRESS)):
            _ip("-n", space, "addr", "add", f"{address}/24", "dev", link)
            _ip("-n", space, "link", "set", link, "up")
            _ip("-n", space, "link", "set", "lo", "up")
        yield near, far, cable
    finally:
        for space in (near, far):
            subprocess.run(["ip", "netns", "del", space], check=False, capture_output=True)


class _Role:
    """A beacon in a namespace; its output is collected."""

    def __init__(self, space: str, role: str, *options: str) -> None:
        command = [
            "ip",
            "netns",
            "exec",
            space,
            sys.executable,
            "-m",
            "verification.faults.beacons",
        ]
        environment = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
        self.process = subprocess.Popen(
            [*command, "--role", role, *options],
            env=environment,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.lines: list[str] = []
        self._pumping = threading.Thread(target=self._pump, daemon=True)
        self._pumping.start()

    def wait_for(self, words: str) -> None:
        """Wait until it said something.

        Raises:
            TimeoutError: it does not.
        """
        give_up = time.monotonic() + PATIENCE_S
        while not any(words in line for line in list(self.lines)):
            if time.monotonic() > give_up:
                raise TimeoutError(f"no {words!r} within {PATIENCE_S:g} s; got {self.lines[-3:]}")
            time.sleep(0.05)

    def finish(self) -> Any:
        """End it and return what it reports."""
        self.process.send_signal(signal.SIGTERM)
        self._pumping.join(PATIENCE_S)
        return json.loads(self.lines[-1])

    def _pump(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.append(line)


def cut(seconds: float) -> Result:
    """Run both, pull the cable for a while, and see."""
    with _network() as (near, far, cable), contextlib.ExitStack() as stack:
        source = _Role(near, "source", "--listen", f"tcp/{ADDRESS}:{PORT}", "--connect", "")
        stack.callback(source.process.kill)
        reader = _Role(
            far, "reader", "--listen", "tcp/127.0.0.1:0", "--connect", f"tcp/{ADDRESS}:{PORT}"
        )
        stack.callback(reader.process.kill)
        reader.wait_for(HEARD)
        time.sleep(SETTLE_S)
        _ip("-n", near, "link", "set", cable, "down")
        down = time.monotonic_ns()
        time.sleep(seconds)
        _ip("-n", near, "link", "set", cable, "up")
        up = time.monotonic_ns()
        time.sleep(SETTLE_S + 2.0)
        return _result(seconds, reader.finish(), source.finish(), (down, up))


def _result(seconds: float, seen: Any, sent: Any, window: tuple[int, int]) -> Result:
    down, up = window
    times, ages, status = seen["times"], seen["ages"], seen["status"]
    limits = {topic.name: topic.max_age for topic in (PLANT_STATE, TELEOP_SETPOINT, TELEOP_GAIT)}
    too_old = sum(
        age > limit + STEP_S for name, limit in limits.items() for age in ages.get(name, [])
    )
    after = [at for at in times if at > up]
    last_before = max((at for at in times if at < (after[0] if after else up)), default=down)
    stops = ages.get(ESTOP.name, [])
    return Result(
        cut_s=seconds,
        stale=sum(status[name]["stale"] for name in limits),
        let_go=sum(status[name]["skipped"] for name in limits),
        applied_too_old=too_old,
        stops=sum(age > 0.5 for age in stops),
        oldest_stop_s=max(stops, default=0.0),
        oldest_gait_s=max(ages.get(TELEOP_GAIT.name, []), default=0.0),
        gap_s=1e-9 * (after[0] - last_before) if after else float("inf"),
        resumed_s=1e-9 * (after[0] - up) if after else float("inf"),
        put_p99_ms=sent["p99"],
        put_max_ms=sent["max"],
    )


def main(argv: Sequence[str] | None = None) -> int:
    """Run and print; 1 if anything too old was applied or nothing came back."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faults.network_cut",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--seconds", type=float, nargs="+", default=[0.5, 1.0, 2.0, 5.0], help="lengths of cuts [s]"
    )
    arguments = parser.parse_args(argv)
    print(
        "cut [s]  stale  let go  applied too old  old stops applied (oldest [s])  "
        "oldest gait [s]  put p99, max [ms]  back after [s]"
    )
    good = True
    for seconds in arguments.seconds:
        r = cut(seconds)
        good &= r.applied_too_old == 0 and r.resumed_s < float("inf")
        print(
            f"{r.cut_s:>7.1f} {r.stale:>6} {r.let_go:>7} {r.applied_too_old:>16} "
            f"{r.stops:>18} ({r.oldest_stop_s:.2f}) {r.oldest_gait_s:>20.3f} "
            f"{r.put_p99_ms:>12.2f} {r.put_max_ms:>6.2f} {r.resumed_s:>14.2f}",
            flush=True,
        )
    return int(not good)


if __name__ == "__main__":
    raise SystemExit(main())
