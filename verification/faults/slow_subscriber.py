"""``python -m verification.faults.slow_subscriber``: does a bad reader hold the robot up?

One process sends what a robot sends (state 200 Hz, command 100 Hz, two eyes of 30 kB at 20 Hz),
one healthy reader takes it, and a second reader is in turn healthy, paused (SIGSTOP), slow (asleep
20 ms a message) or killed (-9), attached as a peer or as a client of the router. Conditions take
turns within one run, so whatever else the machine does meets them all alike.
"""

import argparse
import json
import signal
import subprocess
import sys
import time
from collections import defaultdict
from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from common.ports import PORT_OFFSETS
from common.transport.config import BusConfig
from deploy.ports import reserve_base_port
from verification.faults.slow_roles import READY, ROBOT, publish, read

NAP_S = 0.02
GROUPS = ("state", "command", "image")
_GROUP_OF = (0, 1, 2, 2)
BEHAVIOURS = ("paused", "slow", "killed")
ROUTES = ("peer", "client")


@contextmanager
def _role(name: str, *options: str) -> Iterator["subprocess.Popen[str]"]:
    """A process of this module that has said it is ready; killed at the end if it still runs."""
    command = [
        sys.executable,
        "-m",
        "verification.faults.slow_subscriber",
        "--role",
        name,
        *options,
    ]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        line = process.stdout.readline()
        if line.strip() != READY:
            raise RuntimeError(f"expected {name} to say {READY!r}, got {line!r}")
        yield process
    finally:
        process.kill()
        process.wait()


def _finish(process: "subprocess.Popen[str]") -> Any:
    process.send_signal(signal.SIGTERM)
    text, _ = process.communicate(timeout=30)
    return json.loads(text)


def _behave(process: "subprocess.Popen[str]", behaviour: str, seconds: float) -> tuple[int, int]:
    """Let the bad reader misbehave; returns the window [ns]."""
    started = time.monotonic_ns()
    if behaviour == "paused":
        process.send_signal(signal.SIGSTOP)
    elif behaviour == "killed":
        process.kill()
    time.sleep(seconds)
    ended = time.monotonic_ns()
    if behaviour == "paused":
        process.send_signal(signal.SIGCONT)
    return started, ended


def measure(port: int, rounds: int, seconds: float) -> dict[str, Any]:
    """Run all conditions; returns windows by condition, the publisher's rows, the arrivals."""
    windows: defaultdict[str, list[tuple[int, int]]] = defaultdict(list)
    base = ("--port", str(port))
    with ExitStack() as stack:
        sender = stack.enter_context(_role("publish", *base))
        router = subprocess.Popen(
            [sys.executable, "-m", "deploy.router", "--base-port", str(port)],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        stack.callback(router.wait)
        stack.callback(router.terminate)
        healthy = stack.enter_context(_role("read", *base))
        time.sleep(2.0)
        for _ in range(rounds):
            for route in ROUTES:
                for behaviour in BEHAVIOURS:
                    for how in ("healthy", behaviour):
                        nap = str(NAP_S if how == "slow" else 0.0)
                        with _role("read", *base, "--route", route, "--nap", nap) as other:
                            time.sleep(1.0)
                            window = _behave(other, how, seconds)
                            windows[f"{route} {how}"].append(window)
                        time.sleep(0.5)
        arrivals = _finish(healthy)
        sent = _finish(sender)
    return {"windows": dict(windows), "arrivals": arrivals, **sent}


def summary(result: dict[str, Any]) -> list[dict[str, Any]]:
    """Rows of the table: p50, p99 and max of put [µs] by condition and kind of message."""
    rows = np.array(result["rows"], np.int64)
    groups = np.array(_GROUP_OF)[rows[:, 0]]
    arrivals = np.array(result["arrivals"], np.int64)
    table = []
    for condition, windows in sorted(result["windows"].items()):
        inside = np.zeros(len(rows), bool)
        received = 0
        for start, stop in windows:
            inside |= (rows[:, 1] >= start) & (rows[:, 1] < stop)
            received += int(((arrivals >= start) & (arrivals < stop)).sum())
        row: dict[str, Any] = {"condition": condition}
        row["states sent"] = int((inside & (groups == 0)).sum())
        row["states received"] = received
        for number, name in enumerate(GROUPS):
            took = rows[inside & (groups == number), 2] / 1e3
            p50, p99 = np.percentile(took, [50, 99])
            row[name] = {"p50": float(p50), "p99": float(p99), "max": float(took.max())}
        table.append(row)
    by_name = {row["condition"]: row for row in table}
    for row in table:
        reference = by_name[f"{row['condition'].split()[0]} healthy"]
        for name in GROUPS:
            row[name]["ratio"] = row[name]["p99"] / reference[name]["p99"]
    return table


def _print(table: Sequence[dict[str, Any]]) -> None:
    print(f"{'put, µs':<16}" + "".join(f"{name + ' p50/p99/max (×)':>34}" for name in GROUPS))
    for row in table:
        cells = "".join(
            f"{'{p50:.0f} / {p99:.0f} / {max:.0f} ({ratio:.2f})'.format(**row[name]):>34}"
            for name in GROUPS
        )
        lost = row["states sent"] - row["states received"]
        print(f"{row['condition']:<16}{cells}   healthy reader missed {lost}")


def main() -> int:
    """Measure and print; exit code 1 if a bad reader more than doubles the p99 of a state."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n\n")[0])
    parser.add_argument("--rounds", type=int, default=3, help="times each condition (3)")
    parser.add_argument("--seconds", type=float, default=6.0, help="of each (6)")
    parser.add_argument("--out", type=Path, help="write the table as JSON here")
    parser.add_argument("--role", choices=["publish", "read"], help=argparse.SUPPRESS)
    parser.add_argument("--route", choices=ROUTES, default="peer", help=argparse.SUPPRESS)
    parser.add_argument("--nap", type=float, default=0.0, help=argparse.SUPPRESS)
    parser.add_argument("--port", type=int, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.role is not None:
        _play(options)
        return 0
    with reserve_base_port("127.0.0.1", None) as port:
        result = measure(port, options.rounds, options.seconds)
    table = summary(result)
    print(f"publisher's scheduling: {result['scheduling']}")
    _print(table)
    if options.out is not None:
        options.out.write_text(json.dumps(table, indent=1))
    return int(any(row["state"]["ratio"] > 2.0 for row in table))


def _play(options: argparse.Namespace) -> None:
    config = BusConfig(robot=ROBOT, base_port=options.port)
    if options.role == "publish":
        publish(config)
        return
    peer, router = options.port + PORT_OFFSETS["sim"], options.port - 1
    via = {"peer": ("peer", peer), "client": ("client", router)}[options.route]
    endpoint = f"tcp/127.0.0.1:{via[1]}"
    read(
        BusConfig.model_validate(
            {"robot": ROBOT, "base_port": options.port, "mode": via[0], "connect": (endpoint,)}
        ),
        options.nap,
    )


if __name__ == "__main__":
    raise SystemExit(main())
