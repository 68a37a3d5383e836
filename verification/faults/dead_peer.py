"""``python -m verification.faults.dead_peer``: how soon is a dead service missed?

A source and a reader run as processes under the ordinary live runner, scheduled as services are.
The source is killed (-9), paused (SIGSTOP) or hangs in a step; measured is the time from there
until the reader's runner calls it dead, and from its return until it is called alive again. While
nothing is done to the source, every death told is a false alarm.
"""

import argparse
import queue
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Sequence

import numpy as np

from deploy.ports import reserve_base_port
from verification.faults.beacons import HANG_S, HEARD

PATIENCE_S = 60.0
QUIET_S = (0.3, 0.6)
"""Between the source's return and its next death, drawn anew each time [s]."""
WAYS = ("killed", "paused", "hung")


class Role:
    """One of the two processes; what it prints is put in a queue."""

    def __init__(self, role: str, base_port: int) -> None:
        command = [sys.executable, "-m", "verification.faults.beacons", "--role", role]
        self.process = subprocess.Popen(
            [*command, "--base-port", str(base_port)],
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            text=True,
        )
        self.lines: queue.Queue[str] = queue.Queue()
        threading.Thread(target=self._pump, daemon=True).start()

    def until(self, words: str) -> float:
        """When the process said something with ``words`` [s, monotonic].

        Raises:
            TimeoutError: it does not.
        """
        give_up = time.monotonic() + PATIENCE_S
        while (left := give_up - time.monotonic()) > 0.0:
            try:
                line = self.lines.get(timeout=left)
            except queue.Empty:
                break
            if words in line:
                return 1e-9 * int(line.split()[0])
        raise TimeoutError(f"the reader did not say {words!r} within {PATIENCE_S:g} s")

    def said(self, words: str) -> int:
        """How many lines with ``words`` are waiting; takes them out."""
        count = 0
        while not self.lines.empty():
            count += words in self.lines.get()
        return count

    def end(self) -> None:
        """Kill and reap."""
        self.process.kill()
        self.process.wait()

    def _pump(self) -> None:
        assert self.process.stdout is not None
        for line in self.process.stdout:
            self.lines.put(line)


class Study:
    """Lets a source die again and again."""

    def __init__(self, base_port: int, seed: int) -> None:
        self._port = base_port
        self._random = random.Random(seed)
        self.false_alarms = 0
        self.quiet_s = self._began = 0.0
        self._reader = Role("reader", base_port)
        self._source = Role("source", base_port)

    def begin(self) -> None:
        """Wait until the reader hears the source.

        Raises:
            TimeoutError: it does not.
        """
        self._reader.until(HEARD)
        time.sleep(2.0)  # and the first beats
        self._reader.said("")

    def once(self, way: str) -> tuple[float, float]:
        """Seconds until the death was told, and until the return was."""
        quiet = self._random.uniform(*QUIET_S)
        time.sleep(quiet)
        self.quiet_s += quiet
        self.false_alarms += self._reader.said("no sign of life")
        ways: dict[str, Callable[[], float]] = {
            "killed": self._kill,
            "paused": self._pause,
            "hung": self._hang,
        }
        began = self._began = time.monotonic()
        self._source.process.send_signal(
            {"killed": signal.SIGKILL, "paused": signal.SIGSTOP, "hung": signal.SIGUSR1}[way]
        )
        told = self._reader.until("no sign of life") - began
        returned = ways[way]()
        return told, self._reader.until("alive again") - returned

    def end(self) -> None:
        """End both processes."""
        self._reader.end()
        self._source.end()

    def _kill(self) -> float:
        self._source.process.wait()
        self._source = Role("source", self._port)
        return time.monotonic()

    def _pause(self) -> float:
        time.sleep(0.2)
        self._source.process.send_signal(signal.SIGCONT)
        return time.monotonic()

    def _hang(self) -> float:
        return self._began + HANG_S


def main(argv: Sequence[str] | None = None) -> int:
    """Run and print; 1 if a death was told too late."""
    parser = argparse.ArgumentParser(
        prog="python -m verification.faults.dead_peer", description=__doc__
    )
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    parser.add_argument("--times", type=int, default=20, help="of each way (20)")
    parser.add_argument("--limit", type=float, default=0.1, help="for a death to be told [s] (0.1)")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--base-port", type=int, help="first port (a free block is found)")
    arguments = parser.parse_args(argv)
    late = 0
    with reserve_base_port(wanted=arguments.base_port) as base_port:
        study = Study(base_port, arguments.seed)
        try:
            study.begin()
            print("way      times   told after [ms] p50   p90   max    alive again [ms] p50   max")
            for way in WAYS:
                pairs = np.array([study.once(way) for _ in range(arguments.times)])
                told, back = 1e3 * pairs.T
                late += int((told > 1e3 * arguments.limit).sum())
                print(
                    f"{way:<8} {len(told):>5} {np.median(told):>21.1f} "
                    f"{np.percentile(told, 90):>5.1f} {told.max():>5.1f} "
                    f"{np.median(back):>23.1f} {back.max():>5.0f}",
                    flush=True,
                )
        finally:
            study.end()
    print(f"false alarms: {study.false_alarms} in {study.quiet_s:.0f} s of quiet; late: {late}")
    return int(late > 0)


if __name__ == "__main__":
    raise SystemExit(main())
