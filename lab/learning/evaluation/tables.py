"""Writes tables of policies as Markdown, from the files that evaluations keep."""

from collections.abc import Iterable, Sequence
from pathlib import Path

from common.errors import ConfigError
from lab.learning.evaluation.names import ABLATIONS, policy_name
from lab.learning.evaluation.paper import PAPER, SOURCE
from lab.learning.evaluation.summary import Row, summarise
from lab.learning.evaluation.text import share_text
from lab.trials.operators.specs import PolicySpec
from lab.trials.results import TrialRecord, read_records
from lab.trials.spec import format_spread

ABLATED = ("trill", *(f"trill, {name}" for name in ABLATIONS))
LEGEND = (
    "Success in % [95 %, Wilson] (success or partial success in %) n: trials. Time: median (range) "
    "of the successes [s]. Still: mean time of a trial in which nothing moves [s]. Of a policy "
    "with several sizes of its data set, the largest counts. Paper: " + SOURCE + "."
)


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


def rows_of(records: Iterable[TrialRecord]) -> list[Row]:
    """Return a row for each policy, size of its data set, task and link."""
    return summarise(((record.spec, record.result) for record in records), {})


def names_of(records: Iterable[TrialRecord]) -> dict[str, str]:
    """Return, by label, what sets a policy apart; baselines are not among them."""
    found = {}
    for record in records:
        operator = record.spec.operator
        if isinstance(operator, PolicySpec) and not (operator.constant or operator.pictures):
            found[operator.label] = policy_name(operator.about.get("policy", {}))
    return found


def tables_text(records: Sequence[TrialRecord]) -> str:
    """Return all tables as Markdown."""
    rows, names = rows_of(records), names_of(records)
    largest = _largest(rows)
    # Each kind of operator has code of its own.
    codes = {record.code.source[:12] for record in records if record.operator == "policy"}
    parts = ["# Policies\n", LEGEND + "\n"]
    if len(codes) > 1:
        parts.append(
            f"Policies were run by {len(codes)} versions of the code: {', '.join(sorted(codes))}.\n"
        )
    parts += ["## Success\n", _success_table(largest)]
    if any(names.get(row.label) in ABLATED[1:] and row.link == "none" for row in largest):
        ablated = [row for row in largest if names.get(row.label) in ABLATED]
        parts += ["\n## Ablations\n", _success_table(ablated, ABLATED)]
    return "\n".join([*parts, "\n## All rows\n", _all_rows(rows), ""])


def _largest(rows: Sequence[Row]) -> list[Row]:
    """Return, of the rows of one policy, task and link, the one with the most demonstrations."""
    found: dict[tuple[str, str, str], Row] = {}
    for row in rows:
        at = (row.label, row.task, row.link)
        if at not in found or (row.episodes or 0) > (found[at].episodes or 0):
            found[at] = row
    return list(found.values())


def _success_table(rows: Sequence[Row], paper: Sequence[str] = ("bc", "bc-rnn", "trill")) -> str:
    """Return a table with a row for each task; columns are the policies, and the paper's."""
    columns: dict[str, dict[str, str]] = {}
    for row in rows:
        columns.setdefault(_column(row), {})[row.task] = _cell(row)
    known = {row.task for row in rows}
    tasks = [task for task in dict.fromkeys([*PAPER["trill"], *sorted(known)]) if task in known]
    for name in paper:
        rates = PAPER[name]
        columns[f"paper: {name}"] = {
            task: f"{rates[task].success} ({rates[task].partial})"
            for task in tasks
            if task in rates
        }
    return _markdown(
        ["task", *columns],
        [[task, *(cells.get(task, "") for cells in columns.values())] for task in tasks],
    )


def _column(row: Row) -> str:
    return row.label if row.link == "none" else f"{row.label}; {row.link}"


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
