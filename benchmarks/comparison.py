"""The rows of the performance table: what is compared, how it is judged and shown. Pure."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import median
from typing import NamedTuple

Metrics = Mapping[str, float]
"""What one build gave in one round, by ``workload.metric``."""


class Bound(NamedTuple):
    """A wanted limit: of new / old, or with ``absolute`` of the new build's own figure."""

    limit: float
    absolute: bool = False


@dataclass(frozen=True)
class Row:
    """A figure that is compared.

    Attributes:
        group: name by which it is chosen.
        title: what it is, with its unit.
        metric: its name in :data:`Metrics`.
        per: another metric of the same build and round by which it is divided; empty: none.
        more: whether more is better.
        must: what the new build has to keep; None: only shown.
        aim: what would be better still.
        wall: whether it is wall time, and thus depends on what else the machine does.
    """

    group: str
    title: str
    metric: str
    per: str = ""
    more: bool = False
    must: Bound | None = None
    aim: Bound | None = None
    wall: bool = False

    def values(self, rounds: Iterable[Metrics]) -> list[float | None]:
        """Return its figure in each round; None where it was not measured."""
        return [self._value(metrics) for metrics in rounds]

    def _value(self, metrics: Metrics) -> float | None:
        value, divisor = metrics.get(self.metric), metrics.get(self.per) if self.per else 1.0
        return None if value is None or not divisor else value / divisor

    def keeps(self, bound: Bound, new: float, ratio: float | None) -> bool:
        """Return whether a figure and its ratio are within ``bound``."""
        value = new if bound.absolute else ratio
        return value is not None and (value >= bound.limit if self.more else value <= bound.limit)

    def format_bound(self, bound: Bound | None) -> str:
        """Return ``≥ 1.7 ×`` for a ratio, ``≤ 100`` for a figure."""
        if bound is None:
            return ""
        sign, unit = "≥" if self.more else "≤", "" if bound.absolute else " ×"
        return f"{sign} {bound.limit:g}{unit}"


ROWS = (
    Row(
        "time",
        "simulated time, walking, no cameras [× real time]",
        "walking.speed",
        more=True,
        must=Bound(1.7),
        aim=Bound(2.2),
    ),
    Row(
        "pictures",
        "stereo pair 400×300, rendered and encoded [ms]",
        "pictures.pair_ms",
        must=Bound(0.45),
        aim=Bound(10.0, absolute=True),
    ),
    Row(
        "collect",
        "trill collect door/unlock --jobs 2 [episodes/h]",
        "collect.per_hour",
        more=True,
        must=Bound(2.0),
        aim=Bound(3.0),
        wall=True,
    ),
    Row("collect", "CPU time of an episode [s]", "collect.cpu_s"),
    Row("tick", "tick, DAQP, median [ms]", "tick-daqp.median_ms", must=Bound(0.6)),
    Row("tick", "tick, OSQP, median [ms]", "tick-osqp.median_ms", must=Bound(0.6)),
    Row(
        "placo",
        "tick, DAQP / placo's tick, medians",
        "tick-daqp.median_ms",
        "placo.median_ms",
        aim=Bound(2.0, absolute=True),
    ),
    Row(
        "placo",
        "tick, OSQP / placo's tick, medians",
        "tick-osqp.median_ms",
        "placo.median_ms",
        aim=Bound(2.0, absolute=True),
    ),
    Row(
        "tail",
        "tick, DAQP, p99 / median",
        "tick-daqp.p99_ms",
        "tick-daqp.median_ms",
        must=Bound(1.6, absolute=True),
    ),
    Row(
        "tail",
        "tick, OSQP, p99 / median",
        "tick-osqp.p99_ms",
        "tick-osqp.median_ms",
        must=Bound(1.6, absolute=True),
    ),
    Row(
        "bus",
        "typed / raw Zenoh round trip, back to back, medians",
        "bus.typed_us",
        "bus.zenoh_us",
        must=Bound(1.35, absolute=True),
        aim=Bound(1.2, absolute=True),
        wall=True,
    ),
    Row(
        "cameras",
        "cameras in trill demo, two cores [Hz]",
        "live.camera_hz",
        more=True,
        must=Bound(19.9, absolute=True),
        wall=True,
    ),
    Row(
        "cameras",
        "periods that the cameras missed",
        "live.camera_misses",
        must=Bound(0.0, absolute=True),
        wall=True,
    ),
    Row(
        "memory",
        "controller's process, RSS [MB]",
        "live.rss_mb",
        must=Bound(100.0, absolute=True),
    ),
    Row("memory", "controller's process, PSS [MB]", "live.pss_mb"),
)
GROUPS = tuple(dict.fromkeys(row.group for row in ROWS))


class Result(NamedTuple):
    """A judged row.

    Attributes:
        row: the row.
        old: median over the rounds; None: not measured.
        new: likewise.
        ratio: median of new / old over the rounds, each of which had both in turn.
        low: smallest of these ratios.
        high: largest of them.
        kept: whether the must is kept; None without one.
        aimed: whether the aim is reached; None without one.
    """

    row: Row
    old: float | None
    new: float | None
    ratio: float | None
    low: float | None
    high: float | None
    kept: bool | None
    aimed: bool | None

    @property
    def verdict(self) -> str:
        """Say it in words."""
        if self.new is None:
            return "not measured"
        words = {True: "kept", False: "missed", None: ""}[self.kept]
        aim = {True: "aim reached", False: "aim not reached", None: ""}[self.aimed]
        return ", ".join(filter(None, (words, "" if self.kept is False else aim)))


def judge(row: Row, old: Sequence[Metrics], new: Sequence[Metrics]) -> Result:
    """Judge a row by the rounds of both builds, which belong together in their order.

    A must that could not be measured is not kept.
    """
    before, after = row.values(old), row.values(new)
    ratios = [b / a for a, b in zip(before, after, strict=True) if a and b is not None]
    ratio = median(ratios) if ratios else None
    figure = _median(after)

    def within(bound: Bound | None) -> bool | None:
        return bound and figure is not None and row.keeps(bound, figure, ratio)

    return Result(
        row,
        _median(before),
        figure,
        ratio,
        min(ratios, default=None),
        max(ratios, default=None),
        within(row.must),
        within(row.aim),
    )


def _median(values: Iterable[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return median(known) if known else None


HEAD = ("row", "", "old", "new", "new / old", "rounds", "must", "aim", "")


def table(results: Sequence[Result]) -> list[str]:
    """Return the lines of the table."""
    cells = [HEAD, *(_cells(result) for result in results)]
    widths = [max(len(line[column]) for line in cells) for column in range(len(HEAD))]
    return [
        "  ".join(
            text.rjust(width) if 2 <= column <= 4 else text.ljust(width)
            for column, (text, width) in enumerate(zip(line, widths, strict=True))
        ).rstrip()
        for line in cells
    ]


def _cells(result: Result) -> tuple[str, ...]:
    row = result.row
    spread = "" if result.low is None else f"{result.low:.2f}–{result.high:.2f}"
    return (
        row.group,
        row.title + (" (wall)" if row.wall else ""),
        _figure(result.old),
        _figure(result.new),
        "–" if result.ratio is None else f"{result.ratio:.2f} ×",
        spread,
        row.format_bound(row.must),
        row.format_bound(row.aim),
        result.verdict,
    )


def _figure(value: float | None) -> str:
    return "–" if value is None else f"{value:.3g}" if value < 100 else f"{value:.0f}"
