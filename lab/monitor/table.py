"""Format a :class:`lab.monitor.bus_stats.Snapshot` as a table that fits the terminal.

If not everything fits, the tables of topics and of latencies share the lines that the others
leave. Topics with problems come first and the system's own last; the latencies of the operator's
set-points and images come first. The headings say how many rows are shown.
"""

from collections.abc import Iterable, Sequence
from enum import Enum

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from common.schemas import GuardMode, OperatorStatus
from common.topics import (
    CAMERA_LEFT,
    CAMERA_RIGHT,
    EPISODE,
    HEALTH,
    HEARTBEAT,
    JOURNAL,
    LINK_CHANGE,
    PLANT_STATE,
    TELEOP_GAIT,
    TELEOP_SETPOINT,
    WBC_COMMAND,
)
from lab.monitor.bus_stats import InputRow, PeerRow, ServiceRow, Snapshot, TopicRow
from lab.monitor.ledger_text import add_stages, plain_table, stage_cells, styled
from lab.monitor.status_text import (
    SILENCE,
    format_authority,
    format_controller,
    format_plant,
    policy_line,
    task_line,
    warnings,
)

BAD, GOOD, DIM, ODD = "bold red", "green", "dim", "yellow"

_SYSTEM_TOPICS = {topic.name for topic in (HEALTH, HEARTBEAT, JOURNAL, LINK_CHANGE, EPISODE)}
_FIRST_INPUTS = [
    topic.name
    for topic in (
        TELEOP_SETPOINT, CAMERA_LEFT, CAMERA_RIGHT, WBC_COMMAND, PLANT_STATE, TELEOP_GAIT,
    )
]  # fmt: skip
_HEADER_LINES = 6
"""Title, controller, plant, who has the robot, operator and the operator's progress."""


class Content(Enum):
    """The tables below the lines about the robot."""

    ALL = "all"
    TOPICS = "topics"
    LEDGER = "ledger"


def render_table(
    view: Snapshot, title: str, *, content: Content = Content.ALL, height: int | None = None
) -> RenderableType:
    """Return the whole table under ``title``, in ``height`` lines if that is possible."""
    if not view.topics:
        return Group(Text(title, style="bold"), Text(SILENCE))
    parts: list[RenderableType] = [
        Text(title, style="bold"),
        _robot(view),
        *([] if view.policy is None else [policy_line(view.policy)]),
        *([] if view.task is None else [task_line(view.task)]),
        _operator(view.operator),
        *(Text(line, style=BAD, no_wrap=True, overflow="ellipsis") for line in warnings(view)),
    ]
    topics, ledger = len(view.topics), len(view.ledger)
    taken = 0
    if content is Content.ALL:
        parts.append(_services(view.services))
        parts += [_links(view.links)] if view.links else []
        parts += [_peers(view.peers)] if view.peers else []
        taken = sum(bool(rows) + len(rows) for rows in (view.services, view.links, view.peers))
    else:
        topics *= content is Content.TOPICS
        ledger *= content is Content.LEDGER
    if height is not None:
        headings = bool(topics) + bool(ledger)
        more = (view.task is not None) + (view.policy is not None)
        head = _HEADER_LINES + more + len(warnings(view))
        topics, ledger = share_lines(height - head - taken - headings, topics, ledger)
    parts += [_topics(view.topics, topics)] if topics else []
    parts += [_ledger(view.ledger, ledger)] if ledger else []
    return Group(*parts)


def share_lines(lines: int, topics: int, ledger: int) -> tuple[int, int]:
    """Split ``lines`` between two tables: half each, and what the other one does not need."""
    lines = max(lines, 2)
    fewer = min(ledger, max(lines // 2, lines - topics))
    return min(topics, lines - fewer), fewer


def _robot(view: Snapshot) -> RenderableType:
    """Return the lines of controller, plant and authority."""
    control, plant, authority = view.control, view.plant, view.authority
    bad = plant is None or plant.fallen or plant.guard is GuardMode.ESTOP
    odd = plant is not None and plant.commands_foreign > 0
    return Text.assemble(
        ("controller  ", DIM),
        "silent\n" if control is None else format_controller(control) + "\n",
        ("plant       ", DIM),
        ("silent" if plant is None else format_plant(plant), BAD if bad else ODD if odd else ""),
        ("\nrobot       ", DIM),
        "nobody says who has it" if authority is None else format_authority(authority, plant),
        no_wrap=True,
        overflow="ellipsis",
    )


def _operator(operator: OperatorStatus | None) -> RenderableType:
    if operator is None:
        return Text("operator    no script", style=DIM)
    line = Text.assemble(
        ("operator    ", DIM),
        f"{operator.script} {operator.step}/{operator.steps} {operator.label}",
        (f"  {operator.failed}" if operator.failed else "", BAD),
        no_wrap=True,
        overflow="ellipsis",
    )
    bar = Table.grid()  # It ends the line after the bar.
    bar.add_row(ProgressBar(total=max(1, operator.steps), completed=operator.step, width=60))
    return Group(line, bar)


def _table(
    left: Sequence[str], right: Sequence[str], rows: Iterable[Sequence[Text | str]]
) -> Table:
    """Return a table with columns aligned to the ``left``, then columns aligned to the right."""
    table = plain_table()
    for name in left:
        table.add_column(name, no_wrap=True)
    for name in right:
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        table.add_row(*row)
    return table


def _topics(rows: Sequence[TopicRow], number: int) -> Table:
    """Return the ``number`` most important rows in the order of the table of topics."""
    ranked = sorted(rows, key=lambda row: (not row.has_problems, row.name in _SYSTEM_TOPICS))
    chosen = {row.name for row in ranked[:number]}
    return _table(
        [_heading("topic", number, len(rows), "--topics")],
        [
            *("rate Hz", "nominal", "age ms", "messages"),
            *("gaps", "late", "repeated", "too old", "refused"),
        ],
        [
            (
                Text(row.name, style=BAD if row.stale else ""),
                f"{row.rate:.1f}",
                f"{row.nominal:.0f}" if row.nominal else "event",
                Text(_age(row.age), style=BAD if row.stale else ""),
                str(row.messages),
                *map(_count, (row.gaps, row.late, row.repeated, row.too_old, row.refused)),
            )
            for row in rows
            if row.name in chosen
        ],
    )


def _ledger(rows: Sequence[InputRow], number: int) -> Table:
    """Return the ``number`` most important rows, in order of importance."""
    ranked = sorted(rows, key=lambda row: (_rank(row.health.topic), row.consumer))
    table = _table([_heading("latency, ms", number, len(rows), "--ledger")], [], [])
    add_stages(table)
    for row in ranked[:number]:
        table.add_row(_input(row), *styled(stage_cells(row.health.stages)))
    return table


def _services(rows: Sequence[ServiceRow]) -> Table:
    return _table(
        ["service", "state"],
        ["period", "median", "p99 ms", "missed", "CPU %", "put err", "scheduling"],
        [
            (
                row.health.service,
                _alive() if row.alive else _silent(row.silence),
                f"{1e3 * row.health.period:.1f}",
                f"{1e3 * row.health.step_median:.2f}",
                f"{1e3 * row.health.step_p99:.2f}",
                _count(row.health.deadline_misses),
                f"{100 * row.health.cpu:.0f}",
                _count(row.put_errors),
                row.health.realtime,
            )
            for row in rows
        ],
    )


def _links(rows: Sequence[InputRow]) -> Table:
    return _table(
        ["injected delay", "link"],
        ["requested ms", "p99", "achieved ms", "p99", "lost"],
        [
            (
                _input(row),
                row.health.link,
                f"{1e3 * row.health.requested_mean:.1f}",
                f"{1e3 * row.health.requested_p99:.1f}",
                f"{1e3 * row.health.achieved_mean:.1f}",
                f"{1e3 * row.health.achieved_p99:.1f}",
                _count(row.health.lost),
            )
            for row in rows
        ],
    )


def _peers(rows: Sequence[PeerRow]) -> Table:
    return _table(
        ["peer", "seen by", "state"],
        ["losses", "its clock is behind by"],
        [
            (
                row.peer.source,
                row.seen_by,
                _silent(row.peer.silent) if row.dead else _alive(),
                _count(row.peer.losses),
                f"{1e3 * row.peer.clock_offset:.3f} ± {1e3 * row.peer.clock_error:.3f} ms"
                if row.peer.clock_error >= 0.0
                else Text("unknown", style=ODD),
            )
            for row in rows
        ],
    )


def _heading(name: str, shown: int, total: int, option: str) -> str:
    return name if shown >= total else f"{name} ({shown} of {total}, {option})"


def _rank(topic: str) -> int:
    return _FIRST_INPUTS.index(topic) if topic in _FIRST_INPUTS else len(_FIRST_INPUTS)


def _input(row: InputRow) -> Text:
    return Text.assemble(row.health.topic, (f" > {row.consumer}", DIM))


def _alive() -> Text:
    return Text("alive", style=GOOD)


def _silent(seconds: float) -> Text:
    return Text(f"silent {seconds:.1f} s", style=BAD)


def _age(seconds: float) -> str:
    return f"{1e3 * seconds:.0f}" if seconds < 100.0 else f"{seconds:.0f} s"


def _count(number: int) -> Text:
    return Text(str(number), style=ODD if number else DIM)
