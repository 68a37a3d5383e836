"""``python -m verification.links``: measure injected delays, print a table, keep the numbers."""

import argparse
import csv
import json
import logging
import os
import socket
import sys
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from common.errors import TrillError
from common.links.spec import LinkSpec
from lab.review.delay_plot import Panel, write_histograms
from verification.links import simulated
from verification.links.live import bench
from verification.links.records import Result, Takes

LINKS = ("0", "250ms", "500ms", "normal(122ms, 190ms) seed=7", "paper seed=7")

Measured = list[tuple[Result, Takes]]


def _parse(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m verification.links",
        description="Inject delays on the command link (20 Hz set-points) and the camera link (20 "
        "Hz pictures) and compare what consumers see with what was asked for: live, in separate "
        "processes over Zenoh with links set while they run, and in simulated time. Achieved is "
        "from a message's arrival at the consumer's transport to the step that has it. A consumer "
        "at 100 Hz adds its sampling, 0 to 10 ms; a triggered one steps when a message falls due, "
        "but no more often than 20 times a second, so messages close together wait.",
    )
    parser.add_argument("--seconds", type=float, default=30.0, help="live, for each link (30)")
    parser.add_argument("--simulated", type=float, default=600.0, help="the same, virtual (600)")
    parser.add_argument("--links", nargs="+", default=list(LINKS), metavar="SPEC")
    parser.add_argument("--no-live", action="store_true", help="simulated time only")
    parser.add_argument("--base-port", type=int, help="free ports (found)")
    parser.add_argument("--rt-priority", type=int, help="SCHED_FIFO; 0: none (as the services)")
    parser.add_argument("--out", type=Path, default=Path("runs/studies/links"))
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Measure; 0, or 1 if the processes cannot be measured, 2 for a wrong link."""
    arguments = _parse(argv)
    logging.basicConfig(level=logging.WARNING)
    try:
        for link in arguments.links:
            LinkSpec.parse(link)
    except TrillError as error:
        print(f"links: {error}", file=sys.stderr)
        return 2
    loads = [os.getloadavg()[0]]
    scheduling: dict[str, str] = {}
    try:
        measured = [*_simulated(arguments), *_live(arguments, scheduling)]
    except TrillError as error:
        print(f"links: {error}", file=sys.stderr)
        return 1
    loads.append(os.getloadavg()[0])
    about = {
        "load": [round(load, 1) for load in loads],
        "cores": os.cpu_count(),
        "scheduling": scheduling,
    }
    results = [found for found, _ in measured]
    Console(width=None if sys.stdout.isatty() else 150).print(_table(results))
    print(f"load {loads[0]:.1f} to {loads[1]:.1f} on {os.cpu_count()} cores; {scheduling or ''}")
    _write(arguments.out, measured, about)
    print(f"numbers in {arguments.out}.json and .csv, distributions in {arguments.out}.png")
    return 0


def _simulated(arguments: argparse.Namespace) -> Iterator[tuple[Result, Takes]]:
    with Progress(transient=True) as progress:
        for link in progress.track(arguments.links, description="simulated"):
            yield from simulated.measure(link, arguments.simulated)


def _live(
    arguments: argparse.Namespace, scheduling: dict[str, str]
) -> Iterator[tuple[Result, Takes]]:
    if arguments.no_live:
        return
    base_port = arguments.base_port or _free_base_port()
    with bench(base_port, arguments.rt_priority) as running, Progress(transient=True) as progress:
        for link in progress.track(arguments.links, description="live"):
            yield from running.measure(link, arguments.seconds)
        scheduling |= running.scheduling


def _table(results: list[Result]) -> Table:
    table = Table(title="delays in ms", title_justify="left")
    for name in ("where", "consumer", "link"):
        table.add_column(name, overflow="fold")
    for name in ("n", "asked mean", "p50", "p99", "foretold mean", "achieved mean", "p50", "p99"):
        table.add_column(name, justify="right")
    for name in ("late p50", "p99", "≤ 1 ms"):
        table.add_column(name, justify="right")
    for one in results:
        asked, done = one.requested, one.achieved
        seconds = (asked.mean, asked.p50, asked.p99, one.predicted.mean, done.mean, done.p50)
        table.add_row(
            one.where,
            one.consumer,
            one.link,
            str(one.messages),
            *(f"{1e3 * value:.1f}" for value in (*seconds, done.p99)),
            f"{1e3 * one.error_p50:.2f}",
            f"{1e3 * one.error_p99:.2f}",
            f"{100 * one.on_time:.1f} %",
        )
    return table


def _write(out: Path, measured: Measured, about: dict[str, Any]) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    rows = [asdict(found) for found, _ in measured]
    text = json.dumps({"about": about, "results": rows}, indent=1, ensure_ascii=False)
    out.with_suffix(".json").write_text(text + "\n", encoding="utf-8")
    with out.with_suffix(".csv").open("w", newline="", encoding="utf-8") as file:
        flat = [_flat(row) for row in rows]
        writer = csv.DictWriter(file, list(flat[0]))
        writer.writeheader()
        writer.writerows(flat)
    panels = [
        Panel(
            f"{found.where}: {found.consumer}: {found.link}   n = {found.messages}",
            takes.achieved,
            (("asked mean", found.requested.mean), ("achieved mean", found.achieved.mean)),
        )
        for found, takes in measured
    ]
    write_histograms(out.with_suffix(".png"), panels, columns=3)


def _flat(row: dict[str, Any]) -> dict[str, Any]:
    flat: dict[str, Any] = {}
    for key, value in row.items():
        if isinstance(value, dict):
            flat |= {f"{key}_{name}": figure for name, figure in value.items()}
        else:
            flat[key] = value
    return flat


def _free_base_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 64_000)


if __name__ == "__main__":
    sys.exit(main())
