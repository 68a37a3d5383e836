"""Links and predictions as tables for a terminal."""

from collections.abc import Iterable

from rich.table import Table

from common.links.control import LinkReply
from common.links.predict import Figures, Prediction


def links_table(replies: Iterable[LinkReply], *, delayed_only: bool = False) -> Table:
    """Every input of every service, what is injected there and what came of it."""
    table = Table(title="delays in ms, since each link was set", title_justify="left")
    for name in ("service", "input", "link"):
        table.add_column(name, overflow="fold")
    for name in ("asked mean", "p99", "done mean", "p99", "messages", "held back", "lost"):
        table.add_column(name, justify="right")
    for reply in replies:
        for row in reply.inputs:
            if not row.link:
                if not delayed_only:
                    table.add_row(reply.service, row.topic, "-", style="dim")
                continue
            done = (_ms(row.achieved_mean), _ms(row.achieved_p99)) if row.arrived else ("", "")
            table.add_row(
                reply.service,
                row.topic,
                row.link,
                _ms(row.requested_mean),
                _ms(row.requested_p99),
                *done,
                str(row.arrived),
                _share(row.held_back, row.arrived),
                _share(row.lost, row.arrived),
            )
    return table


def prediction_table(told: Prediction) -> Table:
    """What was asked for beside what will come of it."""
    table = Table()
    table.add_column("delay in ms")
    for name in ("mean", "sd", "p50", "p99"):
        table.add_column(name, justify="right")
    table.add_row("asked for", *_figures(told.requested))
    table.add_row("predicted", *_figures(told.predicted))
    return table


def prediction_words(told: Prediction) -> str:
    """The rest of a prediction, in a line."""
    parts = [f"{100 * told.held_back:.0f} % held back to keep order"]
    if told.clamped:
        parts.append(f"{100 * told.clamped:.0f} % drawn below 0")
    if told.lost:
        parts.append(f"{100 * told.lost:g} % lost")
    if told.uncertainty > 0.002 * max(told.requested.mean, 1e-3):
        parts.append(f"mean to ± {2e3 * told.uncertainty:.1f} ms")
    return ", ".join(parts)


def _figures(figures: Figures) -> tuple[str, str, str, str]:
    return _ms(figures.mean), _ms(figures.sd), _ms(figures.p50), _ms(figures.p99)


def _ms(seconds: float) -> str:
    return f"{1e3 * seconds:.1f}"


def _share(part: int, whole: int) -> str:
    return f"{100.0 * part / whole:.1f} %" if part and whole else "0"
