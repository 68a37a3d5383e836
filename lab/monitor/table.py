"""Draws a :class:`lab.monitor.bus_stats.Snapshot`: as a rich table that fits, or as a plain line.

Where not everything fits, topics and ledger share what the rest leaves: topics in trouble come
first and the system's own last, in the ledger the operator's set-points and pictures come first,
and the headings say how many rows there are.
"""

from collections.abc import Sequence
from enum import Enum

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from common.schemas import ControllerState, OperatorStatus, PlantStatus
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
from lab.monitor.ledger_text import add_stages, plain_table, short_ms, stage_cells, styled
from lab.monitor.task_text import task_line, task_words

SILENCE = "nothing heard yet (services take some seconds to start; is this the right base port?)"
BAD, GOOD, DIM, ODD = "bold red", "green", "dim", "yellow"

_OWN = {topic.name for topic in (HEALTH, HEARTBEAT, JOURNAL, LINK_CHANGE, EPISODE)}
_FIRST = [
    topic.name
    for topic in (
        TELEOP_SETPOINT, CAMERA_LEFT, CAMERA_RIGHT, WBC_COMMAND, PLANT_STATE, TELEOP_GAIT,
    )
]  # fmt: skip
_HEADER_LINES = 5
"""Title, controller, plant, operator and its progress."""


class Show(Enum):
    """What a table is to show beside the robot itself."""

    ALL = "all"
    TOPICS = "topics"
    LEDGER = "ledger"


def draw(
    view: Snapshot, title: str, *, show: Show = Show.ALL, height: int | None = None
) -> RenderableType:
    """The whole table under ``title``, in at most ``height`` lines where that can be."""
    if not view.topics:
        return Group(Text(title, style="bold"), Text(SILENCE))
    parts: list[RenderableType] = [
        Text(title, style="bold"),
        _robot(view.control, view.plant),
        *([] if view.task is None else [task_line(view.task)]),
        _operator(view.operator),
    ]
    topics, ledger = len(view.topics), len(view.ledger)
    if show is Show.ALL:
        parts.append(_services(view.services))
        parts += [_links(view.links)] if view.links else []
        parts += [_peers(view.peers)] if view.peers else []
        taken = sum(bool(rows) + len(rows) for rows in (view.services, view.links, view.peers))
    else:
        taken = 0
        topics, ledger = topics * (show is Show.TOPICS), ledger * (show is Show.LEDGER)
    if height is not None:
        headings = bool(topics) + bool(ledger)
        head = _HEADER_LINES + (view.task is not None)
        topics, ledger = share(height - head - taken - headings, topics, ledger)
    parts += [_topics(view.topics, topics)] if topics else []
    parts += [_ledger(view.ledger, ledger)] if ledger else []
    return Group(*parts)


def share(lines: int, topics: int, ledger: int) -> tuple[int, int]:
    """Give two tables their rows of ``lines``: half each, and what the other does not need."""
    lines = max(lines, 2)
    fewer = min(ledger, max(lines // 2, lines - topics))
    return min(topics, lines - fewer), fewer


def line(view: Snapshot) -> str:
    """The same in one line, for where no table can be drawn."""
    if not view.topics:
        return SILENCE
    parts = []
    if view.operator is not None:
        parts.append(f"step {view.operator.step}/{view.operator.steps} {view.operator.label!r}")
    if view.task is not None:
        parts.append(task_words(view.task))
    if view.control is not None:
        parts.append(_control_words(view.control))
    if view.plant is not None:
        parts.append(_plant_words(view.plant))
    dead = [row.health.service for row in view.services if not row.alive]
    if dead:
        parts.append(f"silent: {', '.join(dead)}")
    troubled = [row.name for row in view.topics if row.stale]
    if troubled:
        parts.append(f"stale: {', '.join(troubled)}")
    for row in view.ledger:
        total = next((s for s in row.health.stages if s.stage == "total"), None)
        if row.health.topic == TELEOP_SETPOINT.name and total is not None:
            parts.append(
                f"set-point to {row.consumer} {short_ms(total.median)}/{short_ms(total.p99)} ms"
            )
    rows = view.topics
    misses = sum(row.health.deadline_misses for row in view.services)
    parts.append(
        f"gaps {sum(row.gaps for row in rows)}, late {sum(row.late for row in rows)}, "
        f"again {sum(row.repeated for row in rows)}, too old {sum(row.too_old for row in rows)}, "
        f"deadline misses {misses}"
    )
    return " | ".join(parts)


def _robot(control: ControllerState | None, plant: PlantStatus | None) -> RenderableType:
    lines = Text(no_wrap=True, overflow="ellipsis")
    lines.append("controller  ", style=DIM)
    lines.append("silent\n" if control is None else _control_words(control) + "\n")
    lines.append("plant       ", style=DIM)
    bad = plant is None or plant.fallen
    lines.append("silent" if plant is None else _plant_words(plant), style=BAD if bad else "")
    return lines


def _operator(operator: OperatorStatus | None) -> RenderableType:
    if operator is None:
        return Text("operator    no script", style=DIM)
    words = Text.assemble(
        ("operator    ", DIM),
        f"{operator.script} {operator.step}/{operator.steps} {operator.label}",
        (f"  {operator.failed}" if operator.failed else "", BAD),
        no_wrap=True,
        overflow="ellipsis",
    )
    bar = Table.grid()  # which ends the bar's line
    bar.add_row(ProgressBar(total=max(1, operator.steps), completed=operator.step, width=60))
    return Group(words, bar)


def _topics(rows: Sequence[TopicRow], number: int) -> Table:
    """The ``number`` rows that matter most, in the topic table's order."""
    ranked = sorted(rows, key=lambda row: (not row.troubled, row.name in _OWN))
    chosen = {id(row) for row in ranked[:number]}
    table = plain_table()
    table.add_column(_heading("topic", number, len(rows), "--topics"), no_wrap=True)
    for name in ("rate Hz", "nominal", "age ms", "messages", "gaps", "late", "again"):
        table.add_column(name, justify="right")
    table.add_column("too old", justify="right")
    table.add_column("refused", justify="right")
    for row in rows:
        if id(row) not in chosen:
            continue
        table.add_row(
            Text(row.name, style=BAD if row.stale else ""),
            f"{row.rate:.1f}",
            f"{row.nominal:.0f}" if row.nominal else "event",
            Text(_age(row.age), style=BAD if row.stale else ""),
            str(row.messages),
            *[
                _count(count)
                for count in (row.gaps, row.late, row.repeated, row.too_old, row.refused)
            ],
        )
    return table


def _ledger(rows: Sequence[InputRow], number: int) -> Table:
    """The ``number`` rows that matter most, those first."""
    ranked = sorted(rows, key=lambda row: (_rank(row.health.topic), row.consumer))
    table = plain_table()
    table.add_column(_heading("latency, ms", number, len(rows), "--ledger"), no_wrap=True)
    add_stages(table)
    for row in ranked[:number]:
        name = Text.assemble(row.health.topic, (f" > {row.consumer}", DIM))
        table.add_row(name, *styled(stage_cells(row.health.stages)))
    return table


def _services(rows: Sequence[ServiceRow]) -> Table:
    table = plain_table()
    table.add_column("service")
    table.add_column("state", no_wrap=True)
    for name in ("period", "median", "p99 ms", "missed", "CPU %", "put err", "scheduling"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        health = row.health
        table.add_row(
            health.service,
            Text("alive", style=GOOD) if row.alive else Text(f"silent {row.silent:.1f} s", BAD),
            f"{1e3 * health.period:.1f}",
            f"{1e3 * health.step_median:.2f}",
            f"{1e3 * health.step_p99:.2f}",
            _count(health.deadline_misses),
            f"{100 * health.cpu:.0f}",
            _count(row.put_errors),
            health.realtime,
        )
    return table


def _links(rows: Sequence[InputRow]) -> Table:
    table = plain_table()
    table.add_column("injected delay", no_wrap=True)
    table.add_column("link", no_wrap=True, overflow="ellipsis")
    for name in ("asked ms", "p99", "done ms", "p99", "lost"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        link = row.health
        table.add_row(
            Text.assemble(link.topic, (f" > {row.consumer}", DIM)),
            link.link,
            *[
                f"{1e3 * value:.1f}"
                for value in (
                    link.requested_mean, link.requested_p99, link.achieved_mean, link.achieved_p99,
                )
            ],
            _count(link.lost),
        )  # fmt: skip
    return table


def _peers(rows: Sequence[PeerRow]) -> Table:
    table = plain_table()
    for name in ("peer", "seen by", "state"):
        table.add_column(name, no_wrap=True)
    for name in ("deaths", "its clock is behind by"):
        table.add_column(name, justify="right", no_wrap=True)
    for row in rows:
        peer = row.peer
        gone = not peer.alive and peer.silent >= 0.0
        table.add_row(
            peer.source,
            row.seen_by,
            Text(f"silent {peer.silent:.1f} s", style=BAD) if gone else Text("alive", style=GOOD),
            _count(peer.deaths),
            f"{1e3 * peer.clock_offset:.3f} ± {1e3 * peer.clock_error:.3f} ms"
            if peer.clock_error >= 0.0
            else Text("unknown", style=ODD),
        )
    return table


def _heading(name: str, shown: int, there: int, option: str) -> str:
    return name if shown >= there else f"{name} ({shown} of {there}, {option})"


def _rank(topic: str) -> int:
    return _FIRST.index(topic) if topic in _FIRST else len(_FIRST)


def _age(seconds: float) -> str:
    return f"{1e3 * seconds:.0f}" if seconds < 100.0 else f"{seconds:.0f} s"


def _count(number: int) -> Text:
    return Text(str(number), style=ODD if number else DIM)


def _control_words(control: ControllerState) -> str:
    gait = ""
    if control.gait:
        gait = f", {control.gait.name.lower()} {100 * control.gait_progress:.0f} %"
    hands = 1e3 * max(control.hand_position_error)
    return (
        f"{control.state.name}{gait}, {control.gaits_completed} gaits done, "
        f"hand error {hands:.0f} mm, DCM error {1e3 * control.dcm_error:.0f} mm"
    )


def _plant_words(plant: PlantStatus) -> str:
    state = "FALLEN, " if plant.fallen else "paused, " if plant.paused else ""
    return (
        f"{state}guard {plant.guard.name}, real-time factor {plant.real_time_factor:.2f}, "
        f"state age at torque {1e3 * plant.age_at_torque_median:.1f} ms "
        f"(p99 {1e3 * plant.age_at_torque_p99:.1f})"
    )
