"""Computes the latency breakdown of a whole log or a span of it, and renders it."""

import csv
from dataclasses import dataclass
from math import inf
from pathlib import Path

from rich.console import Group, RenderableType
from rich.text import Text

from common.errors import SchemaError
from common.journal.ledger import Ledger, LedgerRow, LinkRow
from common.journal.stages import STAGES
from common.journal.tables import InputOutcome
from common.schemas import LinkChange, ServiceHealth, StageTime, StepJournal
from common.topics import HEALTH, JOURNAL, LINK_CHANGE
from common.wire.codec import decode
from lab.errors import LabError
from lab.monitor.ledger_text import LEGEND, add_stages, plain_table, stage_cells, styled
from services.logger.read.reader import LogReader, RecordedMessage

_TOPICS = (JOURNAL, HEALTH, LINK_CHANGE)
_UNUSED = tuple(outcome for outcome in InputOutcome if outcome is not InputOutcome.APPLIED)


@dataclass(frozen=True)
class LedgerTable:
    """Rows for every input and every injected delay of a log, and of a span of it.

    ``seconds`` is the length of the span, ``unreadable`` the number of unusable messages.
    """

    inputs: tuple[LedgerRow, ...]
    links: tuple[LinkRow, ...]
    seconds: float
    unreadable: int


def ledger_table(log: LogReader, begin: float = 0.0, end: float = inf) -> LedgerTable:
    """Compute the latency breakdown of a log.

    It covers the span from ``begin`` to ``end``, since the first message [s].

    Raises:
        LoggerError: the log cannot be read.
        LabError: no journal in it lists inputs of services.
    """
    ledger = Ledger()
    unreadable = 0
    for raw in log.raw_messages(_TOPICS):
        assert raw.topic is not None
        try:
            message = decode(raw.payload, raw.topic.schema, raw.tag or None)
        except SchemaError:
            unreadable += 1
            continue
        if isinstance(message, StepJournal):
            ledger.add(message, *_span(raw, log.start_ns or 0, begin, end))
        elif isinstance(message, ServiceHealth):
            ledger.note_health(message)
        elif isinstance(message, LinkChange):
            ledger.note_change(message)
    rows = tuple(ledger.rows())
    if not rows:
        raise LabError(
            f"{log.path} has no ledger: expected journals of services (topic {JOURNAL.name}) that "
            "list their inputs, got none in this span"
        )
    seconds = min(1e-9 * (log.end_ns - (log.start_ns or 0)), end) - begin
    return LedgerTable(rows, tuple(ledger.links()), seconds, unreadable + ledger.unreadable)


def _span(raw: RecordedMessage, first_ns: int, begin: float, end: float) -> tuple[int, int]:
    """Return the span on the consumer's clock, from the times of the message with its journal.

    The transport time of that message, about a millisecond, is neglected.
    """
    ahead = raw.publish_time - raw.time_ns
    far = 2**62
    return (
        first_ns + round(1e9 * begin) + ahead if begin > 0.0 else -far,
        first_ns + round(1e9 * end) + ahead if end < inf else far,
    )


def render(table: LedgerTable, title: str) -> RenderableType:
    """Return the table for a terminal."""
    ledger = plain_table()
    ledger.add_column("topic > consumer", no_wrap=True)
    ledger.add_column("used", justify="right", no_wrap=True)
    add_stages(ledger)
    for row in table.inputs:
        name = Text.assemble(row.topic, (f" > {row.consumer}", "dim"))
        ledger.add_row(name, str(row.applied), *styled(stage_cells(row.stages)))
    parts: list[RenderableType] = [
        Text(f"{title}  {table.seconds:.1f} s", style="bold"),
        Text(LEGEND, style="dim"),
        ledger,
    ]
    unused = [text for row in table.inputs if (text := _unused(row))]
    if unused:
        parts.append(Text("not used: " + "; ".join(unused), style="yellow"))
    if table.links:
        parts += [Text(""), _links(table.links)]
    if table.unreadable:
        parts.append(Text(f"{table.unreadable} messages could not be used", style="yellow"))
    return Group(*parts)


def _links(rows: tuple[LinkRow, ...]) -> RenderableType:
    links = plain_table()
    links.add_column("injected delay", no_wrap=True)
    links.add_column("link")
    for name in ("requested ms", "p99", "achieved ms", "p99", "passed", "lost"):
        links.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        links.add_row(
            Text.assemble(row.topic, (f" > {row.consumer}", "dim")),
            row.link,
            *[
                f"{1e3 * value:.1f}"
                for value in (
                    row.requested_mean, row.requested_p99, row.achieved_mean, row.achieved_p99,
                )
            ],
            str(row.passed),
            str(row.lost),
        )  # fmt: skip
    return links


def _unused(row: LedgerRow) -> str:
    counts = {kind: row.counts[kind] for kind in _UNUSED if row.counts.get(kind)}
    words = ", ".join(f"{count} {kind.name.lower()}" for kind, count in counts.items())
    return f"{row.topic} > {row.consumer} {words}" if words else ""


def write_csv(path: Path, table: LedgerTable) -> None:
    """Write a row for each input and stage, times in seconds.

    Raises:
        LabError: the file cannot be written.
    """
    try:
        with path.open("w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file)
            head = ("consumer", "topic", "stage", "count", "mean_s", "median_s", "p99_s", "max_s")
            writer.writerow(head)
            for row in table.inputs:
                stages: dict[str, StageTime] = {stage.stage: stage for stage in row.stages}
                for name in STAGES:
                    some, stage = row.samples[name], stages.get(name)
                    if stage is None:
                        continue
                    figures = (some.mean(), stage.median, stage.p99, some.max())
                    cells = [f"{figure:.9f}" for figure in figures]
                    writer.writerow([row.consumer, row.topic, name, len(some), *cells])
    except OSError as error:
        raise LabError(f"cannot write {path}: {error.strerror}") from error
