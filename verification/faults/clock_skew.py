"""``python -m verification.faults.clock_skew``: clocks that are off, one that is set on the way.

A source whose monotonic clock is off sends to a reader; both are processes under the ordinary live
runner. The kernel's clock itself is shifted where time namespaces are permitted (root), otherwise
Python's; a step is always Python's, since no kernel sets a monotonic clock. Shown is what the
reader says in its health message: the estimated offset and its bound against the truth, the
ledger's wire stage by it, and how many states were taken for stale. The truth is known exactly,
because this program made it; uncorrected, the wire stage would be off by all of it.
"""

import argparse
import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from common.inbox.inbox import Inbox
from common.inbox.subscriptions import subscribe
from common.schemas import LinkHealth, PeerHealth, ServiceHealth
from common.topics import HEALTH, PLANT_STATE
from common.transport.config import BusConfig
from common.transport.session import open_session
from deploy.ports import reserve_base_port

PATIENCE_S = 60.0
WATCH_S = 6.0


@dataclass(frozen=True)
class Seen:
    """What one health message of the reader says about the source; durations in seconds."""

    at: float
    peer: PeerHealth
    link: LinkHealth

    @property
    def wire(self) -> tuple[float, float]:
        """Median and 99th percentile; NaN if there is none."""
        stage = next((stage for stage in self.link.stages if stage.stage == "wire"), None)
        return (float("nan"),) * 2 if stage is None else (stage.median, stage.p99)


class Watcher:
    """Listens to the reader's health."""

    def __init__(self, config: BusConfig) -> None:
        self._session: Any = open_session(config, "monitor")
        self._inbox = Inbox((HEALTH,))
        self._subscribers = subscribe(self._session, config.robot, self._inbox, (HEALTH,))

    def seen(self) -> Iterator[Seen]:
        """Health as it comes, until nothing useful came for too long.

        Raises:
            TimeoutError: then.
        """
        give_up = time.monotonic() + PATIENCE_S
        while time.monotonic() < give_up:
            self._inbox.begin_step(time.monotonic_ns())
            health = self._inbox.latest_by_source(HEALTH).get("wbc")
            if health is not None and self._inbox.updated(HEALTH):
                found = _find(health)
                if found is not None:
                    give_up = time.monotonic() + PATIENCE_S
                    yield found
            time.sleep(0.02)
        raise TimeoutError(f"the reader said nothing about the source for {PATIENCE_S:g} s")

    def close(self) -> None:
        """Leave the bus."""
        self._subscribers.clear()
        self._session.close()


def _find(health: ServiceHealth) -> Seen | None:
    peer = next((p for p in health.peers if p.source == "sim" and p.clock_error >= 0.0), None)
    link = next((one for one in health.links if one.topic == PLANT_STATE.name), None)
    if peer is None or link is None or not link.stages:
        return None
    return Seen(time.monotonic(), peer, link)


@contextlib.contextmanager
def _running(base_port: int, *shift: str) -> Iterator[tuple[Watcher, "subprocess.Popen[bytes]"]]:
    """Source with a shifted clock, reader and watcher; yields watcher and source."""
    environment = {k: v for k, v in os.environ.items() if not k.startswith("TRILL_")}
    port = ["--base-port", str(base_port)]
    beacon = ["verification.faults.beacons", "--role"]
    commands = [
        ["verification.faults.shifted", *shift, "--", *beacon, "source", *port],
        [*beacon, "reader", *port],
    ]
    processes = []
    with contextlib.ExitStack() as stack:
        for command in commands:
            process = subprocess.Popen(
                [sys.executable, "-m", *command],
                env=environment,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            processes.append(process)
            stack.callback(process.wait)
            stack.callback(process.kill)
        watcher = Watcher(BusConfig(base_port=base_port))
        stack.callback(watcher.close)
        yield watcher, processes[0]


def skewed(base_port: int, skew: float, namespace: bool) -> tuple[Seen, bool]:
    """Watch for some seconds; returns the last word and whether the bound held all the time."""
    options = ["--skew", str(skew)] + (["--namespace"] if namespace else [])
    with _running(base_port, *options) as (watcher, _):
        begin, held = None, True
        for seen in watcher.seen():
            begin = begin or seen.at
            held &= abs(seen.peer.clock_offset + skew) <= seen.peer.clock_error + 1e-9
            if seen.at > begin + WATCH_S:
                return seen, held
    raise TimeoutError("the reader fell silent")


def stepped(base_port: int, step: float) -> tuple[Seen, float, int]:
    """Set a clock; the last word, how soon health told it [s], and how many states were stale."""
    with _running(base_port, "--step", str(step), "--after", "1e6") as (watcher, source):
        begin = set_at = told = None
        stale = 0
        for seen in watcher.seen():
            begin = begin or seen.at
            if set_at is None:
                stale = seen.link.stale
                if seen.at > begin + WATCH_S:
                    source.send_signal(signal.SIGUSR2)
                    set_at = time.monotonic()
            elif told is None and abs(seen.peer.clock_offset + step) < abs(step) / 2:
                told = seen.at - set_at
            elif told is not None and seen.at > set_at + WATCH_S:
                return seen, told, seen.link.stale - stale
    raise TimeoutError("the reader fell silent")


def _namespaces() -> bool:
    text = "from verification.faults.shifted import enter_time_namespace as e; e(1.0)"
    tried = subprocess.run([sys.executable, "-c", text], capture_output=True, check=False)
    return tried.returncode == 0


def main(argv: Sequence[str] | None = None) -> int:
    """Run and print; 1 if an offset was outside its bound."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faults.clock_skew",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--skew", type=float, nargs="+", default=[0.0, 0.2, -0.2], help="[s]")
    parser.add_argument("--step", type=float, nargs="*", default=[0.15, -0.15], help="[s]")
    parser.add_argument("--base-port", type=int, help="first port (a free block is found)")
    arguments = parser.parse_args(argv)
    namespace, good = _namespaces(), True
    print(f"clocks shifted by {'time namespaces' if namespace else 'Python'}; milliseconds")
    print("source ahead by    reader's offset ± bound    off by   wire median    p99   stale")
    with reserve_base_port(wanted=arguments.base_port) as base_port:
        for skew in arguments.skew:
            seen, held = skewed(base_port, skew, namespace)
            good &= held
            _print(skew, seen, seen.link.stale, "" if held else "   OUTSIDE ITS BOUND")
        for step in arguments.step:
            seen, adopted, stale = stepped(base_port, step)
            held = abs(seen.peer.clock_offset + step) <= seen.peer.clock_error
            good &= held
            _print(step, seen, stale, f"   set on the way; in its health {adopted:.2f} s later")
    return int(not good)


def _print(truth: float, seen: Seen, stale: int, remark: str) -> None:
    peer = seen.peer
    wire, p99 = seen.wire
    print(
        f"{1e3 * truth:>15.1f} {1e3 * peer.clock_offset:>18.4f} ± {1e3 * peer.clock_error:.4f} "
        f"{1e3 * (peer.clock_offset + truth):>11.4f} {1e3 * wire:>13.3f} {1e3 * p99:>6.3f} "
        f"{stale:>7}{remark}",
        flush=True,
    )


if __name__ == "__main__":
    raise SystemExit(main())
