"""``python -m verification.walking``: check the promises about standing, walking and reaching."""

import argparse
import json
import sys
from collections.abc import Sequence
from functools import partial
from math import inf
from pathlib import Path

from common.program import run_program
from lab.trials.campaign import run_campaign
from lab.trials.workers import LocalExecutor
from verification.walking.checks import Check, all_checks, measured
from verification.walking.measures import Numbers


def _parse(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m verification.walking",
        description="Measure standing, walking and reaching in simulated time and compare each "
        "figure with its promise. Exits non-zero if one is broken.",
    )
    parser.add_argument("--gaits", type=int, default=20, help="gaits of each type in a row (20)")
    parser.add_argument("--random", type=int, default=100, help="random gaits in one run (100)")
    parser.add_argument("--only", default="", help="part of a check's name or group")
    parser.add_argument("--jobs", type=int, default=2, help="checks that run side by side (2)")
    parser.add_argument("--out", type=Path, default=Path("runs/studies/walking.json"))
    return parser.parse_args(argv)


def main(argv: list[str] | None = None) -> int:
    """Run the selected checks; return 1 if any promise is broken."""
    arguments = _parse(argv)
    checks = [
        check
        for check in all_checks(arguments.gaits, arguments.random)
        if arguments.only in f"{check.group}: {check.name}"
    ]
    if not checks:
        print(f"no check matches {arguments.only!r}; leave --only away to see all names")
        return 2
    return run_program("walking", lambda: run(checks, arguments), "stopped; nothing was written")


def run(checks: Sequence[Check], arguments: argparse.Namespace) -> int:
    """Run the checks, print their figures and write the file; return 1 if a promise is broken."""
    rows: dict[int, dict[str, object]] = {}
    print(f"{len(checks)} checks, {arguments.jobs} at a time", flush=True)

    def show(index: int, result: tuple[Numbers, float]) -> None:
        check, (numbers, seconds) = checks[index], result
        kept, text = check.keeps(numbers), check.describe(numbers)
        head = {"group": check.group, "check": check.name, "passed": kept, "text": text}
        rows[index] = {**head, **numbers}
        counter, mark = f"[{len(rows)}/{len(checks)}]", "ok  " if kept else "FAIL"
        print(
            f"{counter:>8} {mark} {check.group}: {check.name}: {text} ({seconds:.0f} s)", flush=True
        )

    # Checks show no sign of life meanwhile, and some take many minutes.
    workers = LocalExecutor(arguments.jobs, silence=inf, patience=inf)
    run_campaign(range(len(checks)), partial(measured, checks), workers, on_result=show)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps([rows[i] for i in sorted(rows)], indent=1, ensure_ascii=False)
    arguments.out.write_text(text + "\n", encoding="utf-8")
    failed = sum(not row["passed"] for row in rows.values())
    print(f"\n{len(checks) - failed} kept, {failed} broken; numbers in {arguments.out}")
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
