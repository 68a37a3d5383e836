"""Writes tables of policies as Markdown, from the files that evaluations keep."""

from collections.abc import Sequence
from pathlib import Path

from common.errors import ConfigError
from lab.learning.evaluation.comparison import Column, comparisons, rows_of, tasks_of
from lab.learning.evaluation.paper import SOURCE
from lab.learning.evaluation.summary import Row
from lab.learning.evaluation.text import share_text
from lab.trials.operators.specs import PolicySpec
from lab.trials.results import TrialRecord, read_records
from lab.trials.spec import format_spread

LEGEND = (
    "Success in % [95 %, Wilson] (success or partial success in %) n: trials. Time: median (range) "
    "of the successes [s]. Still: mean time of a trial in which nothing moves [s]. Of a policy "
    "with several sizes of its data set, the largest counts. Paper: " + SOURCE + "."
)
PUBLISHED = "as published"
"""The setting of policies that learn and see as in the paper."""


def read_results(paths: Sequence[Path]) -> list[TrialRecord]:
    """Return the trials in files and folders of evaluations.

    Raises:
        ConfigError: a path is not there, or there are no trials.
        LabError: a file is of something else.
    """
    records: list[TrialRecord] = []
    for path in paths:
        files = sorted(path.glob("*.jsonl")) if path.is_dir() else [path]
        if not files or not files[0].is_file():
            raise ConfigError(
                f"expected files of results in {path}, got none; make some with: trill eval "
                "CHECKPOINT"
            )
        for file in files:
            records += read_records(file)
    return list({record.spec.key: record for record in records}.values())


def tables_text(records: Sequence[TrialRecord]) -> str:
    """Return all tables as Markdown."""
    # Each kind of operator has code of its own.
    codes = {record.code.source[:12] for record in records if record.operator == "policy"}
    parts = ["# Policies\n", LEGEND + "\n", _learned_from(records)]
    if len(codes) > 1:
        parts.append(
            f"Policies were run by {len(codes)} versions of the code: {', '.join(sorted(codes))}.\n"
        )
    for comparison in comparisons(records):
        setting = comparison.setting or PUBLISHED
        parts += [f"## Success: {setting}\n", _table(comparison.kinds)]
        if comparison.ablations:
            parts += [f"\n## Ablations: {setting}\n", _table(comparison.ablations)]
        parts.append("")
    return "\n".join([*parts, "## All rows\n", _all_rows(rows_of(records)), ""])


def _learned_from(records: Sequence[TrialRecord]) -> str:
    """Say whose demonstrations the policies have learned from, and how many."""
    sizes: dict[str, dict[str, set[int]]] = {}
    for record in records:
        if isinstance(record.spec.operator, PolicySpec):
            origin = record.spec.operator.about.get("origin", {})
            tasks = sizes.setdefault(origin.get("operator") or "unknown", {})
            tasks.setdefault(record.spec.task, set()).add(int(origin.get("episodes", 0)))
    text = ""
    for operator, tasks in sizes.items():
        counts = (f"{task} {', '.join(map(str, sorted(n)))}" for task, n in sorted(tasks.items()))
        text += f"Demonstrator: {operator}. Demonstrations learned from: {'; '.join(counts)}.\n"
    return text


def _table(columns: Sequence[Column]) -> str:
    """Return a table with a row for each task; columns are the policies, then the paper's."""
    measured = [column for column in columns if column.rows]
    reported = [column for column in columns if column.paper]
    body = []
    for task in tasks_of(columns):
        cells = [_cell(column.rows[task]) if task in column.rows else "" for column in measured]
        for column in reported:
            rates = column.paper.get(task)
            cells.append(f"{rates.success} ({rates.partial})" if rates else "")
        body.append([task, *cells])
    heads = [column.head for column in measured]
    return _markdown(["task", *heads, *(f"paper: {column.head}" for column in reported)], body)


def _cell(row: Row) -> str:
    text = f"{share_text(row.success)} ({100 * row.partial.share:.0f}) n: {len(row.results)}"
    return text if row.checkpoints < 2 else f"{text} of {row.checkpoints} checkpoints"


def _all_rows(rows: Sequence[Row]) -> str:
    head = ["policy", "task", "link", "demonstrations", "success", "time", "still", "falls"]
    body = [
        [
            *(row.label, row.task, row.link, "" if row.episodes is None else str(row.episodes)),
            *(_cell(row), format_spread(row.times) or "none"),
            *("?" if row.still is None else f"{row.still:.1f}", str(row.falls)),
        ]
        for row in rows
    ]
    return _markdown(head, body)


def _markdown(head: Sequence[str], body: Sequence[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *body]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)
