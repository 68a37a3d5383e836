"""``python -m verification.walking``: run the promises, print a table, keep the numbers."""

import argparse
import json
import logging
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from pathlib import Path

from verification.walking.checks import Check, Outcome, all_checks


def _parse(argv: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        prog="python -m verification.walking",
        description="Measure standing, walking and reaching in simulated time and compare each "
        "figure with its promise. Exits non-zero if one is broken.",
    )
    parser.add_argument("--gaits", type=int, default=20, help="of each type in a row")
    parser.add_argument("--random", type=int, default=100, help="random gaits in one run")
    parser.add_argument("--only", default="", help="part of a group's or check's name")
    parser.add_argument("--jobs", type=int, default=2, help="checks run side by side")
    parser.add_argument("--out", type=Path, default=Path("runs/studies/walking.json"))
    return parser.parse_args(argv)


def _timed(check: Check) -> tuple[Outcome, float]:
    # Silences are part of the study; what the services say about them is not news.
    logging.disable(logging.WARNING)
    start = time.perf_counter()
    return check.run(), time.perf_counter() - start


def main(argv: list[str] | None = None) -> int:
    """Run the selected checks; 1 if any failed."""
    arguments = _parse(argv)
    checks = [
        check
        for check in all_checks(arguments.gaits, arguments.random)
        if arguments.only in f"{check.group}: {check.name}"
    ]
    if not checks:
        print(f"no check matches {arguments.only!r}; leave --only away to see all names")
        return 2
    outcomes: dict[int, Outcome] = {}
    print(f"{len(checks)} checks, {arguments.jobs} at a time", flush=True)
    with ProcessPoolExecutor(arguments.jobs) as pool:
        futures = {pool.submit(_timed, check): index for index, check in enumerate(checks)}
        for future in as_completed(futures):
            index = futures[future]
            outcome, seconds = future.result()
            outcomes[index] = outcome
            check = checks[index]
            mark = "ok  " if outcome.passed else "FAIL"
            counter = f"[{len(outcomes)}/{len(checks)}]"
            print(
                f"{counter:>8} {mark} {check.group}: {check.name}: {outcome.text} "
                f"({seconds:.0f} s)",
                flush=True,
            )
    _write(arguments.out, checks, outcomes)
    failed = sum(not outcome.passed for outcome in outcomes.values())
    print(f"\n{len(checks) - failed} kept, {failed} broken; numbers in {arguments.out}")
    return 1 if failed else 0


def _write(path: Path, checks: list[Check], outcomes: dict[int, Outcome]) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [
        {
            "group": check.group,
            "check": check.name,
            "passed": bool(outcomes[index].passed),
            "text": outcomes[index].text,
            **outcomes[index].numbers,
        }
        for index, check in enumerate(checks)
    ]
    path.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    sys.exit(main())
