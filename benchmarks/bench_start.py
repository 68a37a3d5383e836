"""Measure how fast things start: imports, ``trill --help``, and a killed controller's successor.

- import: a fresh interpreter imports the main module of a service and ends; elapsed time depends
  on what else the machine does, processor time hardly;
- help: ``trill --help`` from beginning to end;
- restart: under ``trill up --no-cameras --no-record`` the controller is killed with SIGKILL; time
  runs from the kill to the first joint command of the controller that the supervisor starts
  instead, by the clock in that command's header.

With ``--against DIR``, another source tree of this project, both are measured in turn, so that
whatever else the machine does meets both alike.

    python benchmarks/bench_start.py [--rounds N] [--sessions N] [--against DIR]
"""

import argparse
import statistics
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

from benchmarks.builds import Build, Cost, own_and
from benchmarks.restarts import SETTLE_S, Recovery, restarts
from common.schemas import GuardMode

MODULES = (
    "services.sim.__main__",
    "services.sim.rendering.cameras",
    "services.wbc.__main__",
    "services.teleop.__main__",
    "services.logger.__main__",
    "deploy.router",
)
HELP = "trill --help"
KILLS = 3
"""Kills in one session: a supervisor restarts a service three times at most."""

Costs = dict[str, dict[str, list[Cost]]]
"""Costs by what was measured and by build."""


def measure_starts(builds: list[Build], rounds: int, folder: Path) -> Costs:
    """Time imports and help ``rounds`` times, the builds in turn."""
    costs: Costs = defaultdict(lambda: defaultdict(list))
    for number in range(rounds + 1):
        for module in MODULES:
            for build in builds:
                if build.has(module):
                    command = [sys.executable, "-c", f"import {module}"]
                    _add(costs, module, build, build.cost(command, folder), number)
        for build in builds:
            _add(costs, HELP, build, build.cost(build.command("--help"), folder), number)
        print(f"imports: round {number}/{rounds}", end="\r", file=sys.stderr)
    return costs


def _add(costs: Costs, name: str, build: Build, cost: Cost, number: int) -> None:
    """Keep a cost; the first round only fills the caches."""
    if number:
        costs[name][build.name].append(cost)


def measure_restarts(
    builds: list[Build], sessions: int, folder: Path, settle: float
) -> dict[str, list[Recovery]]:
    """Kill each build's controller :data:`KILLS` times a session, the builds in turn."""
    results: dict[str, list[Recovery]] = {build.name: [] for build in builds}
    for number in range(sessions):
        for build in builds:
            results[build.name] += restarts(build, KILLS, folder, settle)
            print(f"restarts: session {number + 1}/{sessions}", end="\r", file=sys.stderr)
    return results


def print_starts(costs: Costs, builds: list[Build]) -> None:
    """Print medians, and ratios where there are two builds."""
    for index, kind in enumerate(("elapsed", "processor")):
        seconds = {
            name: {build: [cost[index] for cost in found] for build, found in by_build.items()}
            for name, by_build in costs.items()
        }
        _print_table(f"{kind} time, median [s]", seconds, builds)


def _print_table(title: str, times: dict[str, dict[str, list[float]]], builds: list[Build]) -> None:
    print(f"{title:34}" + "".join(f"{build.name:>10}" for build in builds))
    for name, by_build in times.items():
        medians = [statistics.median(by_build[b.name]) for b in builds if by_build.get(b.name)]
        ratio = f"{medians[0] / medians[1]:9.2f} x" if len(medians) == 2 else ""
        print(f"{name:34}" + "".join(f"{median:10.3f}" for median in medians) + ratio)


def print_restarts(results: dict[str, list[Recovery]]) -> None:
    """Print median and worst, and how often the plant's guard let the robot go limp."""
    medians = []
    for name, found in results.items():
        seconds = [restart.seconds for restart in found]
        limp = sum(GuardMode.DAMP in restart.guards for restart in found)
        medians.append(statistics.median(seconds))
        print(
            f"killed controller, {name}: {len(found)} times, first command after "
            f"{medians[-1]:.2f} s median, {max(seconds):.2f} s worst; guard went limp {limp} times"
        )
    if len(medians) == 2:
        print(f"ratio of the medians: {medians[0] / medians[1]:.2f} x")


def main() -> int:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--rounds", type=int, default=5, help="imports of each module (5)")
    parser.add_argument(
        "--sessions", type=int, default=2, help=f"systems started, {KILLS} kills each (2)"
    )
    parser.add_argument(
        "--settle",
        type=float,
        default=SETTLE_S,
        help=f"a controller runs this long before it is killed [s] ({SETTLE_S:g}); with less than "
        "about 5 its spare is not ready",
    )
    parser.add_argument("--against", type=Path, metavar="DIR", help="source tree to compare with")
    arguments = parser.parse_args()
    builds = own_and(arguments.against)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if arguments.rounds:
            print_starts(measure_starts(builds, arguments.rounds, folder), builds)
        if arguments.sessions:
            print_restarts(measure_restarts(builds, arguments.sessions, folder, arguments.settle))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
