"""Formats results of trials as text."""

from collections import Counter
from collections.abc import Sequence

from lab.trials.links import links_text
from lab.trials.spec import TrialResult, format_spread


def line(result: TrialResult) -> str:
    """Format one trial in one line."""
    gave_up = f"; the operator gave up: {result.gave_up}" if result.gave_up else ""
    doing = "" if result.verdict == "success" else f" ({result.doing})"
    return (
        f"{result.task} seed {result.seed}: {result.verdict} at {result.time:.1f} s: "
        f"{result.reason}{doing}{gave_up}"
    )


def summary(results: Sequence[TrialResult]) -> str:
    """Format a table with a row for each task, then the reasons of all other verdicts."""
    rows = [
        "| task | link | trials | success | partial | failure | time of successes [s] | speed |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for task in dict.fromkeys(result.task for result in results):
        rows.append(_row(task, [result for result in results if result.task == task]))
    reasons = Counter(
        f"{result.task} {result.verdict}: {result.reason}"
        for result in results
        if result.verdict != "success"
    )
    rows += ["", *(f"{count} x {reason}" for reason, count in reasons.most_common())]
    return "\n".join(rows).rstrip()


def _row(task: str, results: Sequence[TrialResult]) -> str:
    count = Counter(result.verdict for result in results)
    times = [result.time for result in results if result.verdict == "success"]
    links = ", ".join(dict.fromkeys(links_text(result.links) for result in results))
    speed = sum(r.simulated for r in results) / max(1e-9, sum(r.wall for r in results))
    return (
        f"| {task} | {links} | {len(results)} | {count['success']} | {count['partial']} "
        f"| {count['failure'] + count['error']} | {format_spread(times)} | {speed:.2f} x |"
    )
