"""Links and predictions as tables for a terminal."""

from collections.abc import Iterable

from rich.table import Table

from common.links.control import LinkReply
from common.links.predict import Prediction
from common.links.summary import DelaySummary


def links_table(replies: Iterable[LinkReply]) -> Table:
    """Tabulate every input of every service with its injected delay, requested and achieved."""
    table = Table(title="delays in ms, since each link was set", title_justify="left")
    for name in ("service", "input", "link"):
        table.add_column(name, overflow="fold")
    for name in ("requested mean", "p99", "achieved mean", "p99", "messages", "held back", "lost"):
        table.add_column(name, justify="right")
    for reply in replies:
        for row in reply.inputs:
            delays = row.delays
            if delays is None:
                table.add_row(reply.service, row.topic, "-", style="dim")
                continue
            achieved = (delays.achieved_mean, delays.achieved_p99)
            table.add_row(
                reply.service,
                row.topic,
                row.link,
                _ms(delays.requested_mean),
                _ms(delays.requested_p99),
                *(_ms(seconds) if delays.pushed else "" for seconds in achieved),
                str(delays.pushed),
                _share(delays.held_back, delays.pushed),
                _share(delays.lost, delays.pushed),
            )
    return table


def prediction_table(prediction: Prediction) -> Table:
    """Tabulate the requested delays beside the predicted ones."""
    table = Table()
    table.add_column("delay in ms")
    for name in DelaySummary._fields:
        table.add_column(name, justify="right")
    table.add_row("requested", *map(_ms, prediction.requested))
    table.add_row("predicted", *map(_ms, prediction.predicted))
    return table


def prediction_text(prediction: Prediction) -> str:
    """Format the shares of messages that a prediction holds, in one line."""
    parts = [f"{100 * prediction.held_back:.0f} % held back to keep order"]
    if prediction.clamped:
        parts.append(f"{100 * prediction.clamped:.0f} % drawn below 0")
    if prediction.spec.loss:
        parts.append(f"{100 * prediction.spec.loss:g} % lost")
    if prediction.uncertainty > 0.002 * max(prediction.requested.mean, 1e-3):
        parts.append(f"mean to ± {2e3 * prediction.uncertainty:.1f} ms")
    return ", ".join(parts)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


def _share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if part and whole else "0"
