"""``python -m verification.faults``: inject faults into a live system and judge its recovery."""

import argparse
import json
import sys
import time
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any, get_origin

from pydantic import ValidationError
from rich.console import Console
from rich.table import Table

from common.errors import TrillError, explain
from common.program import run_program
from lab.progress import ProgressBar
from verification.faults.clock_skew import ClockSkew
from verification.faults.dead_peer import DeadPeer
from verification.faults.inference import Inference
from verification.faults.kill_recorder import KillRecorder
from verification.faults.logger_on_robot import LoggerOnRobot
from verification.faults.network_cut import NetworkCut
from verification.faults.operators import Operators
from verification.faults.plan import FaultPlan, Row, Verdict
from verification.faults.slow_subscriber import SlowSubscriber

Plans = Sequence[type[FaultPlan]]
PLANS: Plans = (
    KillRecorder, SlowSubscriber, LoggerOnRobot, DeadPeer, NetworkCut, ClockSkew, Operators,
    Inference,
)  # fmt: skip
_WIDTH = 120
"""Width of the tables where the output is not a terminal."""


def parser(plans: Plans) -> argparse.ArgumentParser:
    """Build the command line; the fields of the plans are its options."""
    result = argparse.ArgumentParser(
        prog="python -m verification.faults",
        description="Inject faults into a live system and judge its recovery. Exit code: 1 if a "
        "promise is broken or an experiment cannot be run, 2 for wrong options.",
        epilog="\n".join(
            f"{plan.name}\n  set-up    {plan.setup}\n  fault     {plan.fault}\n"
            f"  recovery  {plan.recovery}"
            for plan in plans
        ),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    result.add_argument("names", nargs="*", metavar="NAME", help="experiments to run (all)")
    result.add_argument("--quick", action="store_true", help="short runs, about six minutes")
    result.add_argument("--out", type=Path, default=Path("runs/studies/faults"), metavar="DIR",
                        help="folder of the results, a JSON file each (%(default)s)")  # fmt: skip
    fields = [(name, field, p) for p in plans for name, field in p.model_fields.items()]
    for name in dict.fromkeys(name for name, _, _ in fields):
        same = [(field, plan) for other, field, plan in fields if other == name]
        result.add_argument(
            f"--{name}",
            nargs="+" if get_origin(same[0][0].annotation) is tuple else None,
            metavar=name[0].upper(),
            help="; ".join(f"{p.name}: {f.description} ({f.default})" for f, p in same),
        )
    return result


def main(argv: Sequence[str] | None = None, plans: Plans = PLANS) -> int:
    """Run the chosen experiments; return the exit code."""
    command_line = parser(plans)
    arguments = command_line.parse_args(argv)
    known = {plan.name: plan for plan in plans}
    if unknown := set(arguments.names) - known.keys():
        command_line.error(f"expected {', '.join(known)}, got {', '.join(sorted(unknown))}")
    try:
        chosen = [configured(known[name], arguments) for name in arguments.names or known]
    except ValidationError as error:
        command_line.error(explain(error))
    return run_program(
        "verification.faults",
        lambda: run_all(chosen, arguments.out),
        f"stopped; what has ended is in {arguments.out}",
    )


def run_all(plans: Sequence[FaultPlan], out: Path) -> int:
    """Run experiments and print their verdicts; return 1 if a promise is broken."""
    width = None if sys.stdout.isatty() else _WIDTH
    console = Console(width=width, markup=False, highlight=False)
    verdicts = {plan.name: run(plan, out, console) for plan in plans}
    console.print(_verdicts(verdicts))
    return int(not all(v.kept for of_plan in verdicts.values() for v in of_plan))


def configured(plan: type[FaultPlan], arguments: argparse.Namespace) -> FaultPlan:
    """Combine defaults, quick values and given options (later ones win).

    Raises:
        ValidationError: an option has a wrong value.
    """
    given = {name: getattr(arguments, name) for name in plan.model_fields}
    given = {name: value for name, value in given.items() if value is not None}
    return plan.model_validate({**(plan.quick if arguments.quick else {}), **given})


def run(plan: FaultPlan, out: Path, console: Console) -> list[Verdict]:
    """Run an experiment, print its table and write its numbers to a file in ``out``."""
    console.print(f"\n{plan.name}: {plan.fault}", style="bold")
    started, rows, verdicts = time.monotonic(), [], []
    try:
        with ProgressBar(plan.name) as bar:
            rows = list(plan.measure(bar.advance))
        verdicts = [promise.judge(rows) for promise in plan.promises]
    except (TrillError, OSError) as error:
        verdicts = [Verdict(f"the experiment runs: {error}", 0.0, float("nan"), kept=False)]
    console.print(_table(rows))
    content = {
        "experiment": plan.name,
        "options": plan.model_dump(),
        "seconds": round(time.monotonic() - started, 1),
        "rows": rows,
        "verdicts": [asdict(verdict) for verdict in verdicts],
    }
    out.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, indent=1, ensure_ascii=False)
    (out / f"{plan.name}.json").write_text(text + "\n", encoding="utf-8")
    return verdicts


def _table(rows: Sequence[Row]) -> Table:
    table = Table(box=None)
    headings = list(dict.fromkeys(heading for row in rows for heading in row))
    for heading in headings:
        is_text = any(isinstance(row.get(heading), str) for row in rows)
        table.add_column(heading, justify="left" if is_text else "right")
    for row in rows:
        table.add_row(*(_format(row.get(heading, "")) for heading in headings))
    return table


def _verdicts(results: dict[str, list[Verdict]]) -> Table:
    table = Table("experiment", "promise", title="\npromises", title_justify="left")
    for heading in ("at most", "measured", "verdict"):
        table.add_column(heading, justify="right", no_wrap=True)
    for name, verdicts in results.items():
        for v in verdicts:
            values = (_format(v.limit), _format(v.measured), "kept" if v.kept else "BROKEN")
            table.add_row(name, v.promise, *values, style="" if v.kept else "bold red")
    return table


def _format(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


if __name__ == "__main__":
    raise SystemExit(main())
