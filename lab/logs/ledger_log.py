"""The latency ledger of a whole log or a span of it."""

import csv
from collections.abc import Callable
from dataclasses import dataclass
from math import inf
from pathlib import Path
from typing import Any

from rich.console import Group, RenderableType
from rich.text import Text

from common.errors import SchemaError
from common.journal.journal import Take
from common.journal.ledger import STAGES, Ledger, LedgerRow, LinkRow
from common.schemas import LinkChange, ServiceHealth, StageTime, StepJournal
from common.topics import HEALTH, JOURNAL, LINK_CHANGE
from common.wire.codec import decode
from lab.errors import LabError
from lab.monitor.ledger_text import LEGEND, add_stages, plain_table, stage_cells, styled
from services.logger.read.reader import LogReader, RecordedMessage

_SCHEMAS: dict[str, Any] = {
    JOURNAL.name: StepJournal, HEALTH.name: ServiceHealth, LINK_CHANGE.name: LinkChange,
}  # fmt: skip
_FATES = (Take.STALE, Take.LATE, Take.REFUSED, Take.LOST)


@dataclass(frozen=True)
class LedgerTable:
    """What the journals of a log say.

    Attributes:
        inputs: every input of every service.
        links: every delay that was injected.
        seconds: how long the log is, or the span looked at.
        unreadable: messages that could not be used.
    """

    inputs: tuple[LedgerRow, ...]
    links: tuple[LinkRow, ...]
    seconds: float
    unreadable: int


def ledger_table(
    log: LogReader,
    begin: float = 0.0,
    end: float = inf,
    progress: Callable[[int], None] = lambda _ns: None,
) -> LedgerTable:
    """Read the ledger off a log.

    Args:
        log: to read through.
        begin: from here; from the log's first message [s].
        end: to here [s].
        progress: called now and then with how much of the log was read [ns].

    Raises:
        LoggerError: it cannot be read.
        LabError: nothing in it says what services took in.
    """
    ledger = Ledger()
    unreadable = first_ns = last_ns = 0
    for entry in log.raw_messages():
        first_ns = first_ns or entry.log_time
        last_ns = max(last_ns, entry.log_time)
        if entry.topic is None or entry.topic.name not in _SCHEMAS:
            continue
        progress(entry.log_time - first_ns)
        try:
            message = decode(entry.payload, _SCHEMAS[entry.topic.name], entry.tag or None)
        except SchemaError:
            unreadable += 1
            continue
        if isinstance(message, StepJournal):
            ledger.add(message, *_span(entry, first_ns, begin, end))
        elif isinstance(message, ServiceHealth):
            ledger.note_health(message)
        elif isinstance(message, LinkChange):
            ledger.note_change(message)
    rows = tuple(ledger.rows())
    if not rows:
        raise LabError(
            f"{log.path} has no ledger: expected journals of services (topic {JOURNAL.name}) with "
            "what they took in, got none in this span; logs made before there were journals have "
            "none"
        )
    seconds = min(1e-9 * (last_ns - first_ns), end) - begin
    return LedgerTable(rows, tuple(ledger.links()), seconds, unreadable + ledger.unreadable)


def _span(entry: RecordedMessage, first_ns: int, begin: float, end: float) -> tuple[int, int]:
    """The span on the consumer's clock, by the message that brought its journal.

    That the message itself was under way for a millisecond or so does not matter here.
    """
    ahead = entry.publish_time - entry.log_time
    far = 2**62
    return (
        first_ns + round(1e9 * begin) + ahead if begin > 0.0 else -far,
        first_ns + round(1e9 * end) + ahead if end < inf else far,
    )


def render(table: LedgerTable, title: str) -> RenderableType:
    """Show it to a person."""
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
    fates = [text for row in table.inputs if (text := _fates(row))]
    if fates:
        parts.append(Text("not used: " + "; ".join(fates), style="yellow"))
    if table.links:
        parts += [Text(""), _links(table.links)]
    if table.unreadable:
        parts.append(Text(f"{table.unreadable} messages could not be used", style="yellow"))
    return Group(*parts)


def _links(rows: tuple[LinkRow, ...]) -> RenderableType:
    links = plain_table()
    links.add_column("injected delay", no_wrap=True)
    links.add_column("link")
    for name in ("asked ms", "p99", "done ms", "p99", "passed", "lost"):
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


def _fates(row: LedgerRow) -> str:
    counts = {kind: row.counts[kind] for kind in _FATES if row.counts.get(kind)}
    words = ", ".join(f"{count} {kind.name.lower()}" for kind, count in counts.items())
    return f"{row.topic} > {row.consumer} {words}" if words else ""


def write_csv(path: Path, table: LedgerTable) -> None:
    """Write a row for each input and stage, in seconds.

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
