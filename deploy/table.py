"""Draws a :class:`deploy.board.View`: as a rich table, or as a plain line."""

from rich.console import Group, RenderableType
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from common.schemas import ControllerState, OperatorStatus, PlantStatus
from deploy.board import ServiceRow, TopicRow, View

SILENCE = "nothing heard yet (services take some seconds to start; is this the right base port?)"
BAD, GOOD, DIM = "bold red", "green", "dim"


def draw(view: View, title: str) -> RenderableType:
    """The whole table under ``title``."""
    if not view.topics:
        return Group(Text(title, style="bold"), Text(SILENCE))
    return Group(
        Text(title, style="bold"),
        _robot(view.control, view.plant),
        _operator(view.operator),
        _services(view.services),
        _topics(view.topics),
    )


def line(view: View) -> str:
    """The same in one line, for where no table can be drawn."""
    if not view.topics:
        return SILENCE
    parts = []
    if view.operator is not None:
        parts.append(f"step {view.operator.step}/{view.operator.steps} {view.operator.label!r}")
    if view.control is not None:
        parts.append(_control_words(view.control))
    if view.plant is not None:
        parts.append(_plant_words(view.plant))
    troubled = [row.name for row in view.topics if row.stale]
    if troubled:
        parts.append(f"stale: {', '.join(troubled)}")
    gaps = sum(row.gaps for row in view.topics)
    misses = sum(row.health.deadline_misses for row in view.services)
    parts.append(f"gaps {gaps}, deadline misses {misses}")
    return " | ".join(parts)


def _robot(control: ControllerState | None, plant: PlantStatus | None) -> RenderableType:
    lines = Text()
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
    )
    bar = ProgressBar(total=max(1, operator.steps), completed=operator.step, width=60)
    return Group(words, bar)


def _topics(rows: tuple[TopicRow, ...]) -> Table:
    table = _table()
    table.add_column("topic")
    for name in ("rate Hz", "nominal", "age ms", "messages", "gaps", "refused"):
        table.add_column(name, justify="right")
    for row in rows:
        table.add_row(
            Text(row.name, style=BAD if row.stale else ""),
            f"{row.rate:.1f}",
            f"{row.nominal:.0f}" if row.nominal else "event",
            Text(f"{1e3 * row.age:.0f}", style=BAD if row.stale else ""),
            str(row.messages),
            _count(row.gaps),
            _count(row.refused),
        )
    return table


def _services(rows: tuple[ServiceRow, ...]) -> Table:
    table = _table()
    table.add_column("service")
    table.add_column("state")
    for name in ("period ms", "median ms", "p99 ms", "missed", "CPU %", "scheduling"):
        table.add_column(name, justify="right")
    for row in rows:
        health = row.health
        table.add_row(
            health.service,
            Text("alive", style=GOOD) if row.alive else Text(f"silent {row.age:.0f} s", style=BAD),
            f"{1e3 * health.period:.1f}",
            f"{1e3 * health.step_median:.2f}",
            f"{1e3 * health.step_p99:.2f}",
            _count(health.deadline_misses),
            f"{100 * health.cpu:.0f}",
            health.realtime,
        )
    return table


def _table() -> Table:
    """A table without rules: the whole screen should fit a small terminal."""
    return Table(box=None, pad_edge=False, header_style="bold underline")


def _count(number: int) -> Text:
    return Text(str(number), style="yellow" if number else DIM)


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
