"""``python -m verification.links``: measure injected delays, print a table, keep the numbers."""

import argparse
import json
import logging
import os
import socket
import sys
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import track
from rich.table import Table

from common.links.spec import LinkSpec
from common.program import run_program
from lab.review.delay_plot import Panel, write_histograms
from verification.links import simulated
from verification.links.live import bench
from verification.links.measurement import Measurement

LINKS = ("0", "250ms", "500ms", "normal(122ms, 190ms) seed=7", "paper seed=7")
COLUMNS = (
    *("requested mean", "requested p99", "predicted mean"),
    *("achieved mean", "achieved p50", "achieved p99", "late p50", "late p99"),
)


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
    parser.add_argument("--rt-priority", type=int, help="SCHED_FIFO; 0: none (as the services)")
    parser.add_argument("--out", type=Path, default=Path("runs/studies/links"))
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Measure; exit code 0, 1 if the processes cannot be measured, or 2 for a wrong link."""
    arguments = _parse(argv)
    return run_program("links", lambda: run(arguments), "stopped; nothing was written")


def run(arguments: argparse.Namespace) -> int:
    """Measure, print the table and write the files; returns 0.

    Raises:
        ConfigError: a link is not understood.
        TrillError: the processes cannot be measured.
    """
    logging.basicConfig(level=logging.WARNING)
    about: dict[str, Any] = {"cores": os.cpu_count(), "load": [os.getloadavg()[0]]}
    for link in arguments.links:
        LinkSpec.parse(link)
    measured = _measure(arguments, about)
    about["load"].append(os.getloadavg()[0])
    Console(width=None if sys.stdout.isatty() else 150).print(_table(measured))
    print(", ".join(f"{key}: {value}" for key, value in about.items()))
    _write(arguments.out, measured, about)
    print(f"numbers in {arguments.out}.json, distributions in {arguments.out}.png")
    return 0


def _measure(arguments: argparse.Namespace, about: dict[str, Any]) -> list[Measurement]:
    measured = []
    for link in track(arguments.links, "simulated", transient=True):
        measured += simulated.measure(link, arguments.simulated)
    if not arguments.no_live:
        with bench(_free_base_port(), arguments.rt_priority) as running:
            for link in track(arguments.links, "live", transient=True):
                measured += running.measure(link, arguments.seconds)
            about["scheduling"] = running.scheduling()
    return measured


def _table(measured: list[Measurement]) -> Table:
    table = Table(title="delays in ms", title_justify="left")
    for name in ("where", "consumer", "link"):
        table.add_column(name, overflow="fold")
    for name in ("n", *COLUMNS):
        table.add_column(name, justify="right")
    for one in measured:
        figures = {
            f"{kind} {name}": f"{1e3 * seconds:.2f}"
            for kind, summary in one.summaries.items()
            for name, seconds in summary._asdict().items()
        }
        table.add_row(
            one.where,
            one.consumer,
            one.link,
            str(len(one.late)),
            *(figures[name] for name in COLUMNS),
        )
    return table


def _write(out: Path, measured: list[Measurement], about: dict[str, Any]) -> None:
    out.parent.mkdir(parents=True, exist_ok=True)
    content = {"about": about, "results": [one.as_json() for one in measured]}
    text = json.dumps(content, indent=1, ensure_ascii=False)
    out.with_suffix(".json").write_text(text + "\n", encoding="utf-8")
    links = list(dict.fromkeys(one.link for one in measured))
    panels = [
        Panel(
            f"{one.where}: {one.consumer}: {one.link}   n = {len(one.late)}",
            one.achieved.tolist(),
            [(f"{kind} mean", one.summaries[kind].mean) for kind in ("requested", "achieved")],
        )
        for one in sorted(measured, key=lambda one: links.index(one.link))
    ]
    write_histograms(out.with_suffix(".png"), panels, columns=len(measured) // len(links))


def _free_base_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return min(int(probe.getsockname()[1]), 64_000)


if __name__ == "__main__":
    sys.exit(main())
